"""Fitting, with history, progress, early stop and restart; steps are `descent`'s."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxpd.checks import number, whole
from jaxpd.descent import State, advance, begin
from jaxpd.inverse import Inverse, Penalty, Values, Variable, check_variable
from jaxpd.io import check_folder, load_state, save_state
from jaxpd.observe import Observation
from jaxpd.problem import Params, Problem
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.status import Status

#: Steps without a lower loss after which a fit ends: of L-BFGS, of others.
PATIENCE = (2, 50)
#: Loss over the first from which on data count as met exactly.
EXACT = 1e-20


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found.

    Attributes:
        inverse: the problem.
        z: variables of the lowest loss, without units.
        reason: why it ended: "converged" (no step is expected to lower the loss by more
            than `gtol` of it, or the data are met exactly), "stalled" (the loss no
            longer falls), "steps" (used up) or "failed" (loss or gradient not finite).
        losses: loss at the start and after each step.
        gradients: largest entry of its gradient in z.
        path: values of the scalar variables, by name.
    """

    inverse: Inverse
    z: Values
    reason: str
    losses: np.ndarray
    gradients: np.ndarray
    path: dict[str, np.ndarray]

    @property
    def values(self) -> Values:
        """Values of the variables."""
        return jax.tree.map(np.asarray, self.inverse.values(self.z))

    @property
    def params(self) -> Params:
        """Parameters of the problem with these values."""
        return self.inverse.params(self.z)

    @functools.cached_property
    def residuals(self) -> np.ndarray:
        """(predicted - measured) / sigma of the data that are there [N]."""
        r = np.asarray(jax.jit(Inverse.residuals)(self.inverse, self.z))
        there = [np.isfinite(o.data).ravel() for o in self.inverse.observations]
        return r[np.concatenate(there)]

    @property
    def misfit(self) -> float:
        """Mean square of the residuals; near 1 where model and noise are right."""
        return float(np.mean(self.residuals**2))

    @property
    def steps(self) -> int:
        """Steps taken."""
        return len(self.losses) - 1

    def checked(self) -> Fit:
        """This fit, if it did not fail.

        Raises:
            ValueError: saying which observations could not be predicted.
        """
        if self.reason != "failed":
            return self
        inverse = self.inverse
        seen = jax.jit(Inverse.predictions)(inverse, self.z)
        bad = [
            f"{(~np.isfinite(x)).sum()} of {np.size(x)}" for x in map(np.asarray, seen)
        ]
        ended = Status(int(inverse.problem.solve(self.params)[1].status)).name
        raise ValueError(
            f"fit: {self!r}: at the best point the solve ends with {ended}, and of the "
            f"observations {', '.join(bad)} "
            "predictions are no numbers; start elsewhere, keep variables inside their "
            "domain by bounded(), check the points of observations, or see "
            "solve_static(...).checked()"
        )

    def __repr__(self) -> str:
        """One line: why it ended, loss, values."""
        shown = {
            k: " ".join(f"{x:.6g}" for x in v.ravel())
            if v.size <= 8
            else f"{v.size} from {v.min():.6g} to {v.max():.6g}"
            for k, v in self.values.items()
        }
        return (
            f"Fit({self.reason} after {self.steps} steps, loss {self.losses.min():.3e}"
            f" over {self.inverse.count} data, {shown})"
        )


def fit(
    problem: Problem,
    variables: dict[str, Variable],
    observations: Sequence[Observation] | Observation,
    penalties: Sequence[Penalty] | Penalty = (),
    *,
    method: Any = "lbfgs",
    steps: int = 100,
    rate: float = 0.05,
    gtol: float = 1e-9,
    rtol: float = 1e-12,
    progress: bool = False,
    checkpoint: str | Path | None = None,
    every: int = 1,
) -> Fit:
    """Fit parameters of a problem to observations.

    Args:
        problem: its `params` are the rest. Prepare it with an `rtol` well below the
            noise over the data: a misfit is a small difference of solutions.
        variables: what is sought, by name: `jaxpd.inverse.positive` and others.
        observations: what was measured: `jaxpd.observe.displacements` and others.
        penalties: what is preferred: `jaxpd.inverse.smooth`.
        method: "lbfgs" with a line search, "adam", or any transformation of optax.
        steps: most steps.
        rate: learning rate of Adam, in z.
        gtol: L-BFGS has converged when its next step is expected to lower the loss by
            less than this share.
        rtol: a loss that falls by less than this share has not fallen.
        progress: show a bar (needs tqdm).
        checkpoint: a file that keeps the state; if it exists, the fit goes on from it,
            to the same end, bit by bit.
        every: steps between checkpoints.

    Returns:
        A `Fit`.

    Raises:
        ValueError: on an unknown method or parameter, numbers that are not positive, a
            horizon that may leave the bonds that were found, or a checkpoint of other
            data, starts or parameters.
    """
    if isinstance(method, str) and method not in ("lbfgs", "adam"):
        raise ValueError(
            f"method: {method!r} must be 'lbfgs', 'adam' or a transformation of optax"
        )
    steps, every = whole("steps", steps), whole("every", every)
    number("rate", rate, above=0)
    number("gtol", gtol, least=0)
    number("rtol", rtol, least=0)
    if isinstance(observations, Observation):
        observations = [observations]
    if isinstance(penalties, Penalty):
        penalties = [penalties]
    if len(variables) == 0 or len(observations) == 0:
        raise ValueError("variables, observations: give at least one of each")
    for what, of, kind in (
        ("variables", variables.values(), Variable),
        ("observations", observations, Observation),
        ("penalties", penalties, Penalty),
    ):
        for one in of:
            if not isinstance(one, kind):
                raise ValueError(
                    f"{what}: {type(one).__name__} is no {kind.__name__}; see "
                    "jaxpd.inverse.positive, jaxpd.observe.observation, "
                    "jaxpd.inverse.smooth"
                )
    if not hasattr(problem, "params"):
        raise ValueError(f"problem: {problem!r} must be of prepare(scene)")
    for name, variable in variables.items():
        check_variable(problem, name, variable)
    inverse = Inverse(problem, variables, tuple(observations), tuple(penalties))
    mark, file = _mark(inverse, method, rate), None
    if checkpoint is not None:
        file = check_folder(checkpoint)
    inverse = jax.device_put(inverse)
    state = begin(inverse, method, rate)
    if file is not None and file.exists():
        state = load_state(file, state, mark)
    with _bar(progress, steps) as show:
        while not (reason := _ended(state, method, steps, gtol, rtol)):
            if file is not None and (state.taken - 1) % every == 0:
                save_state(file, state, mark)
            state = advance(state, inverse, method, rate)
            show(state)
    if file is not None and reason != "failed":
        save_state(file, state, mark)
    names = [k for k, v in variables.items() if not np.ndim(v.start)]
    path = dict(zip(names, state.path.T, strict=True))
    return Fit(inverse, state.best, reason, state.losses, state.gradients, path)


def _mark(inverse: Inverse, method: Any, rate: float) -> str:
    """What tells this fit from others: its numbers and settings, not its solver."""
    problem = inverse.problem
    if any(f.name == "linear" for f in dataclasses.fields(problem)):
        problem = dataclasses.replace(problem, linear=LinearSolver())
    told = hashlib.sha256(repr(problem.spec).encode())
    for leaf in jax.tree.leaves(dataclasses.replace(inverse, problem=problem)):
        x = np.asarray(leaf)
        told.update(f"{x.dtype}{x.shape}".encode() + x.tobytes())
    how = f"by {method} at rate {rate}" if isinstance(method, str) else "by optax"
    return f"a fit {how} of {sorted(inverse.variables)}, {told.hexdigest()[:16]}"


def _ended(state: State, method: Any, steps: int, gtol: float, rtol: float) -> str:
    """Why the fit ends, or nothing."""
    loss, lbfgs = float(state.loss), method == "lbfgs"
    if not np.isfinite([loss, state.gradients[-1]]).all():
        return "failed"
    expected = -state.fall if lbfgs and state.taken > 1 else np.inf
    exact = abs(loss) <= EXACT * abs(state.losses[0]) or state.gradients[-1] == 0
    if exact or 0 <= expected <= gtol * abs(loss):
        return "converged"
    late = PATIENCE[0 if lbfgs else 1]
    if state.taken > late:
        before = state.losses[:-late].min()
        if not state.losses[-late:].min() < before - rtol * abs(before):
            return "stalled"
    return "steps" if state.taken > steps else ""


@contextlib.contextmanager
def _bar(wanted: bool, steps: int) -> Iterator[Callable[[State], None]]:
    if not wanted:
        yield lambda state: None
        return
    try:
        from tqdm.auto import tqdm  # noqa: PLC0415
    except ImportError as error:
        raise ValueError(
            "progress: True needs tqdm; pip install 'jaxpd[progress]', or leave it out"
        ) from error
    with tqdm(total=steps + 1, desc="fit") as bar:

        def show(state):
            bar.update(state.taken - bar.n)
            bar.set_postfix(loss=f"{float(state.loss):.3e}")

        yield show
