"""Files: the state of a long run, written at once or not at all, and without pickle."""

from __future__ import annotations

import hashlib
import os
import re
import zipfile
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxpd.checks import instance


def save_state(file: str | Path, state: Any, mark: str) -> None:
    """Write a pytree of arrays to an .npz file.

    Args:
        file: replaced in one go; a run that is killed leaves the old one or the new.
        state: the pytree.
        mark: says whose it is; `load_state` asks for it.
    """
    file = check_folder(file)
    leaves: dict[str, Any] = {
        f"leaf{k}": np.asarray(x) for k, x in enumerate(jax.tree.leaves(state))
    }
    beside = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with open(beside, "wb") as to:
            np.savez(to, mark=np.array(mark), **leaves)
            to.flush()
            os.fsync(to.fileno())
        os.replace(beside, file)
    finally:
        beside.unlink(missing_ok=True)


def check_folder(file: str | Path) -> Path:
    """The path, if its folder exists.

    Raises:
        ValueError: if it does not.
    """
    path = Path(file)
    if not path.parent.is_dir():
        raise ValueError(f"file: there is no folder {path.parent}; make it first")
    return path


def make_folder(folder: str | Path) -> Path:
    """A folder, made if need be; the one above it exists.

    Raises:
        ValueError: if it is no path, no folder, or cannot be made.
    """
    path = Path(instance("folder", folder, str | Path, "the path of a folder"))
    if not path.parent.is_dir():
        raise ValueError(f"folder: there is no folder {path.parent}; make it first")
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise ValueError(f"folder: {path} cannot be made ({error.strerror})") from error
    return path


def load_state(file: str | Path, like: Any, mark: str) -> Any:
    """Read a pytree that `save_state` wrote, bit by bit the same.

    Args:
        file: the file.
        like: a pytree of the same structure.
        mark: whose it must be.

    Raises:
        ValueError: if the file is of something else, or none of jaxpd's.
    """
    leaves, tree = jax.tree.flatten(like)
    names = [f"leaf{k}" for k in range(len(leaves))]
    try:
        with np.load(file, allow_pickle=False) as kept:
            found = str(kept["mark"])
            if found == mark and set(kept.files) == {"mark", *names}:
                return jax.tree.unflatten(tree, [kept[name] for name in names])
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise ValueError(f"file: {file} is no state of jaxpd ({error})") from error
    raise ValueError(
        f"file: {file} is of {found}, and this is {mark}; delete it or name another"
    )


def digest(tree: Any, *words: Any) -> str:
    """16 letters that tell a pytree and some words from others, bit by bit."""
    told = hashlib.sha256()
    leaves, structure = jax.tree.flatten(tree)
    # functions print where they lie in memory
    shown = re.sub(r" at 0x[0-9a-f]+", "", str(structure))
    for word in (shown, *map(repr, words)):
        told.update(word.encode())
    for leaf in leaves:
        array = np.ascontiguousarray(leaf)
        told.update(f"{array.dtype}{array.shape}".encode())
        told.update(array.tobytes())
    return told.hexdigest()[:16]


def write_series(
    folder: str | Path, X: np.ndarray, t: np.ndarray, fields: dict[str, np.ndarray]
) -> list[Path]:
    """Write point fields over time as VTU files, and a .pvd that names them.

    Args:
        folder: made if it does not exist.
        X: positions [n, d] (m).
        t: times [F] (s).
        fields: [F, n] or [F, n, d] by name.

    Returns:
        The VTU files; open "series.pvd" beside them in ParaView.

    Raises:
        ValueError: without frames, or if the folder cannot be made.
        ModuleNotFoundError: naming the line that installs meshio.
    """
    try:
        import meshio  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "VTU files need meshio; install it with: pip install 'jaxpd[mesh]'"
        ) from error
    if len(t) == 0:
        raise ValueError("t: there are no frames; say frames= to run_explicit")
    folder = make_folder(folder)

    def in_space(x: np.ndarray) -> np.ndarray:
        return x if x.ndim == 1 else np.pad(x, [(0, 0), (0, 3 - x.shape[1])])

    points, cells = in_space(np.asarray(X, float)), np.arange(len(X))[:, None]
    written, entries = [], []
    for k, time in enumerate(t):
        data: Any = {
            name: in_space(np.asarray(x[k], float)) for name, x in fields.items()
        }
        path = folder / f"frame_{k:06d}.vtu"
        meshio.write(path, meshio.Mesh(points, [("vertex", cells)], point_data=data))
        written.append(path)
        entries.append(f'<DataSet timestep="{float(time)!r}" file="{path.name}"/>')
    series = "\n".join(
        [
            '<VTKFile type="Collection" version="0.1">',
            "<Collection>",
            *entries,
            "</Collection>",
            "</VTKFile>",
            "",
        ]
    )
    (folder / "series.pvd").write_text(series)
    return written
