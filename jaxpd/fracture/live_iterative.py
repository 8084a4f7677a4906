"""A body that loses springs, solved anew by an iteration after each loss.

The stiffness is that of the whole body, by index lists, stencil or convolution, less a
growing list of lost springs; nothing is compiled anew until the list has doubled. Each
solve starts from the last displacements. The preconditioner is that of the body as it
was when it was made, and is made again from what stands when iterations have doubled.
Dynamic relaxation, the habit of the field, is there to be compared with.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxpd._types import PointTensor, PointVector
from jaxpd.fracture.live import DirectLive
from jaxpd.geometry import GridFamily
from jaxpd.operators import Constraints
from jaxpd.operators.springs import Springs, SpringTangent
from jaxpd.problem import Problem, first_tangent
from jaxpd.solvers.amg import build_hierarchy
from jaxpd.solvers.krylov import block_jacobi, pcg
from jaxpd.solvers.relaxation import SPARE, relax
from jaxpd.solvers.status import Status

#: Iterations over those after the last set-up that ask for a new one, and how few do
#: not matter.
WORSE, FEW = 1.8, 6
#: Places of the list of lost springs to begin with; it doubles, and compiles anew.
ROOM = 1024
METHODS = ("d-pcg", "multigrid", "amg", "spectral", "relaxation")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Less:
    """Stiffness of a whole body less that of lost springs.

    Attributes:
        whole: a `Tangent`.
        lost: of springs; padded with ones of no stiffness.
    """

    whole: Any
    lost: SpringTangent

    symmetric = True

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        return self.whole.mv(du) - self.lost.mv(du)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m)."""
        return self.whole.diagonal() - self.lost.diagonal()


@functools.partial(jax.jit, static_argnames=("maxiter",))
def _relax(K, constraints, load, u, rtol, maxiter):
    """The same by adaptive dynamic relaxation."""

    class Moving:
        """The force as `relax` asks for it."""

        def commit(self, u, history):
            return -K.mv(u.T).T, history

    # u.K u <= 2 sum u_i.K_ii u_i, and the trace is above the largest eigenvalue
    mass = 0.5 * SPARE * jnp.trace(K.diagonal(), axis1=1, axis2=2)
    mass = jnp.where(mass > 1e-9 * jnp.max(mass), mass, jnp.max(mass))
    start = constraints.lift() + constraints.project(u)
    fixed = jnp.asarray(constraints.fixed).T
    u, _, steps, rest, _ = relax(
        Moving(), mass, load.T, fixed, start.T, None, rtol, maxiter
    )
    return u.T, steps, rest <= rtol


@functools.partial(jax.jit, static_argnames=("maxiter",))
def _solve(K, constraints, load, u, cycle, rtol, maxiter):
    project = constraints.project
    lift = constraints.lift()
    b = project(load - K.mv(lift))
    near: Any
    if cycle is None:
        blocks: Any = constraints.diagonal(K.diagonal())
        # a point that has lost all bonds has no stiffness: any number will do
        trace = jnp.trace(blocks, axis1=1, axis2=2)
        bare = trace < 1e-9 * jnp.max(trace)
        eye = jnp.eye(blocks.shape[1], dtype=blocks.dtype)
        blocks = jnp.where(bare[:, None, None], eye[None], blocks)
        # collinear bonds leave a block singular: its diagonal does not
        entries = jnp.diagonal(blocks, axis1=1, axis2=2)
        floor = 1e-3 * jnp.max(entries, axis=1)[:, None, None]
        near = block_jacobi(blocks + floor * eye[None])
    else:  # a cycle may not know of every prescribed entry
        near = lambda r: project(cycle.cycle(r))  # noqa: E731

    x, info = pcg(
        lambda v: project(K.mv(v)),
        b,
        precondition=near,
        rtol=rtol,
        maxiter=maxiter,
        x0=project(u),
    )
    return lift + project(x), info


class IterativeLive:
    """`Live` by preconditioned conjugate gradients, or by relaxation."""

    def __init__(
        self,
        problem: Problem,
        springs: Springs,
        intact: NDArray[np.bool_],
        method: str,
        rtol: float,
        maxiter: int,
    ):
        """Solve the body that stands.

        Args:
            problem: the whole body with its linear solver.
            springs: all springs, on the host.
            intact: which of them stand [b].
            method: one of `METHODS`.
            rtol: relative tolerance of each residual.
            maxiter: most iterations of a solve.
        """
        self.problem, self.springs, self.method = problem, springs, method
        self.u = np.zeros(problem.X.shape)
        self.torn, self.floppy = False, np.zeros(len(self.u), bool)
        self._limits = (rtol, maxiter)
        self._whole = jax.jit(first_tangent)(problem)
        params = problem.params
        self._held = Constraints(
            jnp.asarray(problem.fixed), jnp.asarray(params["prescribed"])
        )
        self._load = jnp.asarray(params["load"])
        self._lost = np.zeros(0, np.int64)
        self._cycle = problem.linear.hierarchy
        self._best = np.inf
        self._direct: DirectLive | None = None
        self.cost: dict[str, float] = {
            "factorisations": 0,
            "solves": 0,
            "iterations": 0,
            "direct": 0,
        }
        self.intact = intact.copy()
        self._lost = np.flatnonzero(~intact)
        if len(self._lost):
            self._renew()  # one that knows the cracks of the scene
        self.lose(np.zeros(0, np.int64))

    def _gone(self) -> SpringTangent:
        """The lost springs, padded to a power of two."""
        room = max(ROOM, 1 << int(np.ceil(np.log2(max(len(self._lost), 1)))))
        at = np.zeros(room, np.int64)
        at[: len(self._lost)] = self._lost
        some = jax.tree.map(lambda x: jnp.asarray(x[at]), self.springs)
        k = jnp.where(jnp.arange(room) < len(self._lost), some.k, 0.0)
        return SpringTangent(some, k, len(self.u))

    def lose(self, bonds: NDArray[np.integer]) -> None:
        """Take springs away, and follow with u."""
        bonds = bonds[self.intact[bonds]]
        self.intact[bonds] = False
        if self._direct is not None:
            self._follow(bonds)
            return
        self._lost = np.concatenate([self._lost, bonds])
        count, good = self._go()
        if good and self._best == np.inf:
            self._best = max(count, FEW)
        if (count > WORSE * self._best or not good) and self._renew():
            if not good:
                count, good = self._go()
            self._best = np.inf if good else self._best
        if not good:  # a piece has come off, or a preconditioner has lost its hold
            self._direct = self._factorised()
            self._follow(np.zeros(0, np.int64))

    def settle(self) -> dict[str, Any]:
        """Displacements, and which springs stand."""
        return {
            "u": self.u,
            "floppy": self.floppy,
            "intact": self.intact.copy(),
            "cost": dict(self.cost),
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Go on from what `settle` gave; to the tolerance, not to the bit."""
        self.u = kept["u"]
        self.lose(np.flatnonzero(self.intact & ~kept["intact"]))
        self.cost |= {name: float(count) for name, count in kept["cost"].items()}

    def _go(self) -> tuple[int, bool]:
        K = Less(self._whole, self._gone())
        rtol, maxiter = self._limits
        args = (K, self._held, self._load, jnp.asarray(self.u))
        if self.method == "relaxation":
            u, steps, good = _relax(*args, rtol, maxiter)
            count, good = int(steps), bool(good)
        else:
            u, info = _solve(*args, self._cycle, rtol, maxiter)
            count, good = int(info.iterations), int(info.status) == Status.CONVERGED
        self.cost["solves"] += 1
        self.cost["iterations"] += count
        if good:
            self.u = np.array(u)
        return count, good

    def _renew(self) -> bool:
        """A preconditioner of what stands; False where there is none."""
        method, problem = self.method, self.problem
        fixed = np.asarray(problem.fixed)
        try:
            if method == "amg":
                k = np.where(self.intact, self.springs.k, 0.0)
                K = SpringTangent(self.springs, k, len(self.u)).to_bsr()
                self._cycle = build_hierarchy(K, np.asarray(problem.X), fixed)
            elif method == "multigrid":
                self._cycle = self._torn().solver("multigrid").hierarchy
            else:
                return False
        except (ValueError, np.linalg.LinAlgError):
            return False  # what stands has pieces that are free
        self.cost["factorisations"] += 1
        return True

    def _torn(self) -> Problem:
        """The lattice less the lost springs; its corrections know of them too."""
        family = self.problem.family
        assert isinstance(family, GridFamily)
        i, j = self.springs.i[self._lost], self.springs.j[self._lost]
        at = [np.stack(np.unravel_index(x, family.shape), 1) for x in (i, j)]
        step = at[1] - at[0]
        first = np.array([tuple(s) > (0,) * len(s) for s in step.tolist()])
        step[~first] *= -1
        slots = {o: k for k, o in enumerate(family.offsets)}
        slot = np.array([slots[tuple(s)] for s in step.tolist()], np.int32)
        return self.problem.without(np.stack([np.where(first, i, j), slot]))

    def _factorised(self) -> DirectLive:
        fixed, params = np.asarray(self.problem.fixed), self.problem.params
        # with all bonds to begin with: what hangs loose is found bond by bond
        live = DirectLive(
            self.springs,
            fixed,
            np.asarray(params["prescribed"]),
            np.asarray(params["load"]),
            np.ones(len(self.intact), bool),
        )
        live.lose(np.flatnonzero(~self.intact))
        self.cost["direct"] = 1
        return live

    def _follow(self, bonds: NDArray[np.integer]) -> None:
        live = self._direct
        assert live is not None
        live.lose(bonds)
        self.u, self.torn, self.floppy = live.u, live.torn, live.floppy
