"""Files: the state of a long run, written at once or not at all, and without pickle."""

from __future__ import annotations

import os
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import jax
import numpy as np


def save_state(file: str | Path, state: Any, mark: str) -> None:
    """Write a pytree of arrays to an .npz file.

    Args:
        file: replaced in one go; a run that is killed leaves the old one or the new.
        state: the pytree.
        mark: says whose it is; `load_state` asks for it.
    """
    file = Path(file)
    leaves: dict[str, Any] = {
        f"leaf{k}": np.asarray(x) for k, x in enumerate(jax.tree.leaves(state))
    }
    with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as to:
        try:
            np.savez(to, mark=np.array(mark), **leaves)
            to.flush()
            os.fsync(to.fileno())
            os.replace(to.name, file)
        except BaseException:
            os.unlink(to.name)
            raise


def load_state(file: str | Path, like: Any, mark: str) -> Any:
    """Read a pytree that `save_state` wrote, bit by bit the same.

    Args:
        file: the file.
        like: a pytree of the same structure.
        mark: whose it must be.

    Raises:
        ValueError: if the file is of something else, or none of jaxpd's.
    """
    tree = jax.tree.structure(like)
    names = [f"leaf{k}" for k in range(tree.num_leaves)]
    try:
        with np.load(file, allow_pickle=False) as kept:
            found = str(kept["mark"])
            if found == mark and set(kept.files) == {"mark", *names}:
                return jax.tree.unflatten(tree, [kept[name] for name in names])
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise ValueError(f"file: {file} is no state of jaxpd ({error})") from error
    raise ValueError(
        f"file: {file} is of {found} and not of {mark}; delete it or name another"
    )
