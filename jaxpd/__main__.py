"""The command line: `python -m jaxpd`, or a scene by file or name.

python -m jaxpd                        the main job: the cracked plate, checked
python -m jaxpd SCENE.toml             run a scene file, draw a picture
python -m jaxpd SCENE.toml --plan      print how it would be modelled, and why
python -m jaxpd SCENE.toml --resume    go on from its checkpoints
python -m jaxpd NAME [key=value ..]    run a scene of the gallery
python -m jaxpd --gallery              list them
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import jax

from jaxpd import command, main_job, plot
from jaxpd.solvers.status import NotConverged


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m jaxpd SCENE",
        description="Run a scene: a TOML file, or a name of the gallery.",
    )
    add = parser.add_argument
    add("scene", help="FILE.toml, or a name that --gallery lists")
    add("words", nargs="*", help="arguments of a gallery scene, as m=3")
    add("--plan", action="store_true", help="print the plan, run nothing")
    add("--resume", action="store_true", help="go on from checkpoints")
    add("--out", type=Path, default=None, help="folder of results (default .)")
    add("--json", action="store_true", help="print JSON")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run what was asked for; returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    if len(words) > 1 and words[0] == "--gallery":
        _parser().error(
            f"--gallery: lists, and takes no {words[1]!r}; `python -m jaxpd {words[1]}`"
            " runs one"
        )
    if words in (["--gallery"], ["gallery"], ["examples"]):
        print(command.listed())
        return 0
    scene = any(w.endswith(".toml") or w in ("--plan", "--resume") for w in words)
    if not words or (words[0].startswith("-") and not scene):
        return main_job.main(words)
    return _scene(words)


def _scene(words: list[str]) -> int:
    started = time.perf_counter()
    parser = _parser()
    args = parser.parse_intermixed_args(words)
    jax.config.update("jax_enable_x64", True)
    file = None
    try:
        file = command.find(args.scene, args.words)
        if args.plan:
            made = command.planned(file)
            print(json.dumps(made.as_dict(), indent=1) if args.json else made)
            return 0
        out = args.out or Path(file.output.get("folder", "."))
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            parser.error(f"--out: {out} cannot be made ({error.strerror})")
        if file.output.get("picture", True):
            plot.pyplot()
        found, job, doubts = command.execute(file, out, args.resume)
        doubts += command.doubts_of(found, job)
        told = command.report(found, job, file, out, started)
        told |= {"warnings": doubts} if doubts else {}
        command.clear(file, out)
    except ValueError as error:
        parser.error(str(error) if file is None else command.placed(error, file))
    except (OSError, ModuleNotFoundError) as error:
        parser.error(str(error))
    except NotConverged as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped; --resume goes on where checkpoints are kept", file=sys.stderr)
        return 130
    if args.json:
        print(json.dumps(told, indent=1))
    else:
        doubts = told.pop("warnings", [])
        print("\n".join(f"{name:<8} {value}" for name, value in told.items()))
        print("".join(f"warning: {doubt}\n" for doubt in doubts), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
