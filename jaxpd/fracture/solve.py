"""The door of slow fracture: `solve_fracture`."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxpd import io
from jaxpd.checks import instance, number, numbers, whole, word
from jaxpd.discretize.surface import VOLUMES
from jaxpd.fracture.breaking import Fracture, prepare_fracture
from jaxpd.fracture.events import Limits, check_loaded, follow
from jaxpd.fracture.growth import Growth
from jaxpd.fracture.live import DirectLive
from jaxpd.fracture.live_iterative import METHODS, IterativeLive
from jaxpd.fracture.softening import Soft, check_softening, soften
from jaxpd.fracture.states import NEVER, States
from jaxpd.fracture.steps import march
from jaxpd.geometry import Family, Region
from jaxpd.physics.bilinear import checked_ratio
from jaxpd.prepare import prepare
from jaxpd.problem import OPERATORS
from jaxpd.progress import bar
from jaxpd.run import peak_memory
from jaxpd.scene import Scene

#: States between checkpoints.
EVERY = 50
#: Relative differences of stretches that are round-off.
TIES = 1e-7
#: Unknowns up to which factors are worth their memory, in 1-D, 2-D and 3-D.
DIRECT = {1: 10**7, 2: 100_000, 3: 15_000}


@jax.jit
def _numbers(fracture: Fracture) -> Any:
    params = fracture.params
    return fracture.springs(params), fracture.critical(params)


def solve_fracture(
    scene: Scene,
    *,
    factors: Sequence[float] | float | None = None,
    few: int | None = None,
    ties: float | None = None,
    toughness: str | float = "nominal",
    softening: float | None = None,
    amount: float | None = None,
    solver: str = "auto",
    operator: str = "auto",
    rtol: float = 1e-10,
    maxiter: int = 2000,
    end: Region | None = None,
    severed: float = 1e-6,
    max_factor: float = np.inf,
    max_states: int = 20_000,
    watch: Sequence[Region] = (),
    folder: str | Path | None = None,
    progress: bool | None = None,
) -> Growth:
    """Break a scene slowly, from one equilibrium to the next.

    Supports and loads of the scene are those at the load factor 1; all grow and fall
    with one factor. Displacements are small, bonds break in tension alone and for good.

    Args:
        scene: what breaks, see `prepare_fracture`; `weak` and `no_fail` say where.
        factors: None follows the exact path from one breaking bond to the next, the
            factor rising or falling as it must. Load factors, rising, take load steps;
            a number takes steps of that share of the first breaking factor.
        few: of load steps: how many bonds go in a pass; None is all above strength.
        ties: relative distance from the most stretched within which bonds go together:
            mirror images do. 0.01 to 0.05 saves events and moves G by about 1 %. None
            is 1e-7, or 1000 rtol of an iterative solver where that is more: what it
            cannot tell apart goes together.
        toughness: "nominal", "lattice", or a ratio G / G0 that is divided out.
        softening: None is brittle. A ratio above 1 lets bonds soften in a straight line
            instead, from the stretch s_crit / ratio^(1/2) to s_crit ratio^(1/2) with
            the same energy; 10 and a weak plane make G that of the lattice. The path is
            then controlled by the energy that is spent, snap-back included; with
            `factors` by load steps, and what else they need (`Growth.fallbacks`).
        amount: of softening: largest energy that a step spends (J); None is 8 times
            that of the middle one of the bonds.
        solver: "direct", a factorisation that is corrected bond by bond; or iterative:
            "d-pcg", "multigrid", "amg", "spectral", "relaxation" (dynamic relaxation).
            "auto" is direct up to a size. Of softening bonds "direct" or "d-pcg", which
            turns to the factors where curvature is negative.
        operator: of iterative solvers, "gather", "stencil" or "fft".
        rtol: tolerance of each residual of an iterative solver.
        maxiter: most iterations of a solve. Where one fails, it goes on directly.
        end: it ends when a bond with its middle in this region has gone.
        severed: it ends when the stiffness has fallen to this share of the first.
        max_factor: it ends there.
        max_states: most states; a path that needs more is not done.
        watch: regions whose mean displacements are kept.
        folder: keeps a checkpoint every 50 states, made if need be. A path that was
            killed goes on from it; with "direct" to the same bits.
        progress: a bar of the states, by tqdm; None shows it on a terminal.

    Returns:
        A `Growth`; call its `checked()` to be sure that it came to an end.

    Raises:
        ValueError: as `prepare_fracture`, on arguments out of range, or a folder of
            another path.
    """
    started = time.perf_counter()
    _check(factors, softening, few, ties, solver, rtol, severed, max_states)
    number("max_factor", max_factor, above=0, endless=True)
    word("operator", operator, ("auto", *OPERATORS))
    whole("maxiter", maxiter)
    if amount is not None:
        number("amount", amount, above=0, cure="in J")
    if end is not None:
        instance("end", end, Region, "a region, as box(..)")
    instance("watch", watch, list | tuple, "a list, as in [region]")
    for region in watch:
        instance("watch", region, Region, "a list of regions, as in [box(..)]")
    brittle = {"few": few, "ties": ties, "folder": folder}
    check_softening(softening, amount, solver, brittle)
    fracture = prepare_fracture(scene, toughness)
    springs, s_crit = jax.tree.map(np.asarray, _numbers(fracture))
    X, fixed = np.asarray(fracture.X), np.asarray(fracture.fixed)
    load, cut = np.asarray(fracture.params["load"]), np.asarray(fracture.cut)
    if solver == "auto":
        solver = _solver(fracture) if softening is None else "direct"
    if ties is None:
        ties = TIES if solver == "direct" else max(TIES, 1000.0 * rtol)
    for region in watch:
        if not region.contains(X).any():
            raise ValueError(f"watch: no point lies in {region}")
    middle = 0.5 * (X[springs.i] + X[springs.j])
    last = np.zeros(len(cut), bool) if end is None else end.contains(middle)
    limits = Limits(max_states, max_factor, last, severed)
    if end is not None and not last.any():
        raise ValueError(f"end: no bond has its middle in {end}")
    seen = tuple(region.contains(X) for region in watch)
    if softening is not None:
        counter = bar(range(1, max_states), max_states, progress, "state")
        soft = Soft(softening, factors, amount, solver, lambda: next(counter, None))
        return soften(scene, fracture, (springs, s_crit), limits, seen, soft, started)
    live: Any
    if solver == "direct":
        moved = np.asarray(fracture.params["prescribed"])
        live = DirectLive(springs, fixed, moved, load, ~cut)
    else:
        live = _iterative(scene, springs, ~cut, solver, operator, rtol, maxiter)
    states = States(springs, fixed, load, cut, seen)
    mark = "a slow fracture, "
    how = (few, ties, solver, operator, rtol, severed, max_factor, watch)
    asked = np.atleast_1d(np.nan if factors is None else factors)
    mark += io.digest((fracture, last, asked), *map(repr, how))
    keep = Keeper(folder, mark, live, states)
    ready = time.perf_counter()
    counter = bar(range(len(states.rows), max_states), max_states, progress, "state")

    def pause() -> bool:
        next(counter, None)
        keep.now()
        return False

    if factors is None:
        stopped = follow(live, states, s_crit, ties, limits, pause)
    else:
        stopped = march(live, states, s_crit, factors, few, ties, limits, pause)
    check_loaded(states.rows, stopped)
    seconds = {"prepare": ready - started, "path": time.perf_counter() - ready}
    return _growth(scene, fracture, live, states, stopped, seconds)


def _solver(fracture: Fracture) -> str:
    """Factors as long as they fit, else the preconditioner of a lattice, or AMG."""
    X, family = fracture.X, fracture.problem.family
    assert isinstance(family, Family)
    if X.size <= DIRECT[X.shape[1]]:
        return "direct"
    alike = fracture.problem.spec.correction in VOLUMES
    return "multigrid" if alike and family.bulk.shape[0] else "amg"


class Keeper:
    """Checkpoints of a path."""

    def __init__(self, folder: str | Path | None, mark: str, live: Any, states: States):
        """Take up what is in a folder, or begin at rest."""
        self.live, self.states, self.mark = live, states, mark
        self.file = None
        if folder is not None:
            self.file = io.make_folder(folder) / "growth.npz"
        states.add(0.0, live.u, live.intact, accepted=True, critical=-1, **live.cost)
        self._next = EVERY
        if self.file is not None and self.file.exists():
            kept = io.load_state(self.file, self._pack(live.settle()), mark)
            states.unpack(kept["states"])
            live.restore(kept["live"])
            self._next = len(states.rows) + EVERY

    def _pack(self, live: Any) -> dict[str, Any]:
        return {"states": self.states.pack(), "live": live}

    def now(self) -> None:
        """Write a checkpoint if it is time."""
        if self.file is None or len(self.states.rows) < self._next:
            return
        self._next = len(self.states.rows) + EVERY
        io.save_state(self.file, self._pack(self.live.settle()), self.mark)


def _check(
    factors: Any,
    softening: float | None,
    few: int | None,
    ties: float | None,
    solver: str,
    rtol: float,
    severed: float,
    max_states: int,
) -> None:
    """Refuse arguments out of range."""
    if factors is not None:
        numbers("factors", factors)
        some = np.atleast_1d(np.asarray(factors, float))
        rising = (np.diff(some, prepend=0.0) > 0).all()
        # softening bonds unload and load again
        good = np.isfinite(some).all() and (rising or softening is not None)
        if some.ndim != 1 or not len(some) or not good:
            raise ValueError(f"factors: {factors} must rise strictly, from above 0")
    if few is not None:
        whole("few", few)
    if few is not None and factors is None:
        raise ValueError(f"few: {few} is for load steps; give factors, as 0.02")
    if ties is not None:
        number("ties", ties, above=0, below=1, cure="1e-7 is round-off")
    word("solver", solver, ("auto", "direct", *METHODS))
    for name, value in (("rtol", rtol), ("severed", severed)):
        number(name, value, above=0, below=1)
    whole("max_states", max_states, 2)
    if softening is not None:
        checked_ratio(softening)


def _iterative(
    scene: Scene,
    springs: Any,
    intact: np.ndarray,
    solver: str,
    operator: str,
    rtol: float,
    maxiter: int,
) -> IterativeLive:
    law = getattr(scene.material, "law", scene.material)
    whole = dataclasses.replace(
        scene, material=law, cracks=(), no_fail=(), weak=(), kinematics="small"
    )
    method = "d-pcg" if solver == "relaxation" else solver
    problem = prepare(whole, operator=operator, solver=method)
    return IterativeLive(problem, springs, intact, solver, rtol, maxiter)


def _growth(
    scene: Scene,
    fracture: Fracture,
    live: Any,
    states: States,
    stopped: str,
    seconds: dict[str, float],
) -> Growth:
    column = states.column
    lost = ~live.intact & (states.broken_at == NEVER)
    states.broken_at[lost] = len(states.rows)  # after the last state
    names = ("solves", "iterations", "factorisations", "seconds")
    cost = {name: np.diff(column(name), prepend=0.0) for name in names}
    return Growth(
        scene=scene,
        fracture=fracture,
        springs=states.springs,
        factor=column("factor"),
        force=column("force"),
        pull=column("pull"),
        critical=column("critical").astype(int),
        accepted=column("accepted").astype(bool),
        held=states.held,
        reaction=np.array(states.reactions),
        watched=np.array(states.watched),
        stored=column("stored"),
        work=column("work"),
        released=column("released"),
        bonds=column("bonds"),
        broken_at=states.broken_at,
        u=states.last_u,
        floppy=live.floppy,
        cost=cost,
        fallbacks={"direct": int(live.cost.get("direct", 0))},
        stopped=stopped,
        done=not stopped.startswith("the limit"),
        seconds=seconds,
        peak_memory=peak_memory(),
    )
