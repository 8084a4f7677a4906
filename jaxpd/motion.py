"""A scene made ready to move: one pure function of its parameters and of time.

`jaxpd.launch.prepare_motion` builds what does not change into a `Motion`, a pytree
whose floating-point defaults are `motion.params`. `build` makes operator and drive of
any such parameters; `march` integrates and may be differentiated in reverse, with the
memory of the square root of the steps. `jaxpd.run_explicit` drives the same functions
from the host.

Bonds that break are frozen in a derivative: it is that of a run in which the same bonds
break in the same steps. It is wrong wherever another parameter would break other bonds,
and zero in G0. `softening=` of `prepare_motion` makes the loss gradual instead.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxpd._types import PointScalar, PointVector
from jaxpd.course import Course
from jaxpd.discretize.extension import Extension
from jaxpd.geometry.family import Family, partial_volumes
from jaxpd.geometry.grid_family import offset_lengths, offset_shares
from jaxpd.glue import glue_force, glue_mass
from jaxpd.operators import BondForce, Pulled, StencilForce
from jaxpd.operators.halves import HalfForce
from jaxpd.operators.memory import MemoryForce
from jaxpd.operators.pulled_motion import PulledMotion
from jaxpd.operators.slots import SlotForce, slot_force
from jaxpd.operators.sum_motion import SumMotion
from jaxpd.physics.damage import Brittle, Softening, critical_stretch
from jaxpd.problem import Params
from jaxpd.solvers.explicit import Drive, State, begin, verlet


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Motion:
    """A scene made ready to move.

    Attributes:
        problem: points and bonds, none of them cut: a `Problem`, of a laminate a
            `Stack`.
        params: defaults of what may be varied or differentiated: E [] or [n] (Pa) with
            alpha, ratio or omega of the influence function, or `law`; rho [] or [n]
            (kg/m^3); G0 [] (J/m^2) where bonds break; u0, v0 [n, d] (m, m/s); load
            [q, n, d] (N) and prescribed [p, n, d] (m, or m/s of a velocity), one a
            history in time.
        fixed: mask of prescribed displacement components [n, d].
        begin: the operator's memory at time 0, cut by the cracks.
        untouched: the same without cracks.
        vol: volumes [n] (m^d).
        no_fail: mask of points whose bonds never break [n], or None.
        order: numbers of the points along a curve [n], for "slots".
        course: how it is modelled, static.
        plies: of a laminate the motion of each ply; `params` are then nested, and
            `begin` has a memory a ply and a layer.
    """

    problem: Any
    params: Params
    fixed: Any
    begin: Any
    untouched: Any
    vol: PointScalar
    no_fail: Any
    order: Any
    course: Course = field(metadata={"static": True})
    plies: tuple[Motion, ...] = ()

    @property
    def X(self) -> PointVector:
        """Reference positions [n, d] (m)."""
        return self.problem.X

    def _bonds(self, params: Params) -> Any:
        """The elastic operator and the critical stretch."""
        kept = self.problem.params
        shared = {name: params[name] for name in kept if name in params}
        bonds: Any = self.problem.bonds(kept | shared)
        if not self.course.breaks:
            return bonds, math.inf
        law, d = bonds.law, self.X.shape[1]
        c = law.c / self.problem.spec.stiffening
        s = critical_stretch(params["G0"], c, law.omega, d, kept["delta"])
        if self.no_fail is not None:
            more = 0 if self.problem.extension is None else len(bonds.P.sources)
            s = jnp.where(jnp.pad(self.no_fail, (0, more)), math.inf, s)
        return bonds, s

    def operator(self, params: Params) -> Any:
        """The operator of the given parameters; see `jaxpd.operators.protocol`."""
        if self.plies:
            pairs = zip(self.plies, params["plies"], strict=True)
            plies = tuple(ply.operator(p) for ply, p in pairs)
            op = SumMotion(plies, self._joints(params), self.problem.sizes)
            return op.placed()
        bonds, s_crit = self._bonds(params)
        if isinstance(bonds, Pulled):
            op = self._operator(bonds.op, s_crit, bonds.P(jnp.asarray(self.vol)))
            dtype = jnp.dtype(self.course.dtype)
            weights = jnp.asarray(bonds.P.weights, dtype)
            return PulledMotion(op, Extension(bonds.P.sources, weights))
        return self._operator(bonds, s_crit, self.vol)

    def _joints(self, params: Params) -> tuple[Any, ...]:
        """The interlayers of the given parameters."""
        layers = params["interlayers"]
        each = zip(self.problem.glue, layers, self.no_fail, strict=True)
        return tuple(self._cast(glue_force(*one)) for one in each)

    def _cast(self, tree: Any) -> Any:
        """The same with floating-point numbers of the motion's kind."""
        dtype = jnp.dtype(self.course.dtype)
        return jax.tree.map(
            lambda x: (
                jnp.asarray(x, dtype)
                if jnp.issubdtype(jnp.result_type(x), jnp.floating)
                else x
            ),
            tree,
        )

    def _mass(self, params: Params) -> Any:
        """Masses [n] (kg)."""
        if not self.plies:
            n = len(self.X)
            return jnp.broadcast_to(jnp.asarray(params["rho"]), (n,)) * self.vol
        plies = zip(self.plies, params["plies"], strict=True)
        mass = jnp.concatenate([ply._mass(p) for ply, p in plies])
        for one in zip(self.problem.glue, params["interlayers"], strict=True):
            mass = mass + glue_mass(*one, len(mass))
        return mass

    def _operator(
        self, bonds: Any, s_crit: Any, vol: Any
    ) -> HalfForce | SlotForce | MemoryForce:
        cast = self._cast
        if isinstance(bonds, StencilForce):
            law, family = bonds.law, bonds.family
            nodal = jnp.ndim(law.c) == 1
            stiff = bonds.weight * law.omega(offset_lengths(family, bonds.dx))
            share = offset_shares(family, self.problem.params["delta"], bonds.dx)
            return HalfForce(
                stiff=cast(stiff if nodal else stiff * law.c),
                dx=cast(bonds.dx),
                s_crit=cast(s_crit),
                c=cast(law.c if nodal else None),
                v=cast(bonds.v),
                scale=cast(bonds.scale),
                share=cast(share),
                family=family,
                breaks=self.course.breaks,
            )
        delta, family = bonds.delta, self.problem.family
        assert isinstance(family, Family)
        vol = jnp.asarray(vol)
        share = partial_volumes(bonds.X, vol, family, delta)
        share = jax.lax.map(lambda slot: slot[1] * vol[slot[0]], (family.nbr, share))
        if self.course.kind == "slots":
            op = slot_force(bonds, jnp.asarray(s_crit), share, jnp.asarray(self.order))
            return cast(dataclasses.replace(op, breaks=self.course.breaks))
        law = bonds.law
        if self.course.softening is not None:
            width = self.course.softening
            # so that it costs G0, see Softening
            s_soft = jnp.asarray(s_crit) / (1.0 + width**2 / 9.0) ** 0.5
            law = Softening(law, s_soft, width)
        elif not hasattr(law, "advance"):
            law = Brittle(law, jnp.asarray(s_crit))
        X, weight, law, delta, share = cast((bonds.X, bonds.weight, law, delta, share))
        return MemoryForce(BondForce(X, bonds.nbr, weight, law, delta), share)

    def build(self, params: Params) -> tuple[Any, Drive]:
        """Operator and drive of the given parameters.

        Raises:
            ValueError: if names are missing or unknown.
        """
        if set(params) != set(self.params):
            odd = sorted(set(params) ^ set(self.params))
            raise ValueError(
                f"params: {odd} must be absent or given, as in motion.params | "
                f"{{name: value}}; there are {sorted(self.params)}"
            )
        n, d = self.X.shape
        for name in set(params) - {"law", "omega", "plies", "interlayers"}:
            shape, usual = jnp.shape(params[name]), jnp.shape(self.params[name])
            nodal = name in ("E", "rho", "G0") and shape in ((), (n,))
            if shape != usual and not nodal:
                raise ValueError(
                    f"{name}: shape {shape} must be {usual}, the usual one"
                )
        op, dtype = self.operator(params), jnp.dtype(self.course.dtype)

        def lay(x):
            return op.lay(jnp.asarray(x, dtype))

        mass = op.lay(self._mass(params))
        mass = jnp.where(op.lay(np.ones(n)) > 0.0, mass, 1.0)  # empty places
        mass = jnp.asarray(mass, dtype)
        shape = (0, d, len(mass))
        loads = [lay(x) for x in params["load"]]
        moves = [lay(x) for x in params["prescribed"]]
        held = None
        if len(moves):
            held = op.lay(jnp.asarray(self.fixed, dtype)) > 0.5
        return op, Drive(
            mass,
            jnp.stack(loads) if loads else jnp.zeros(shape, dtype),
            held,
            jnp.stack(moves) if moves else None,
        )

    def first(self, op: Any, params: Params) -> State:
        """The state at time 0."""
        dtype, course = jnp.dtype(self.course.dtype), self.course
        u, v = (jnp.asarray(params[name], dtype) for name in ("u0", "v0"))
        if course.moves:
            values = jnp.asarray(params["prescribed"], dtype)
            held = [
                sum(float(at) * x for at, x in zip(factors, values, strict=True))
                for factors in zip(*(t.at_start() for t in course.moves), strict=True)
            ]
            u, v = (
                jnp.where(self.fixed, x, y) for x, y in zip(held, (u, v), strict=True)
            )
        return begin(op, op.lay(u), op.lay(v), self.begin)

    def march(
        self,
        params: Params | None = None,
        *,
        dt: float,
        every: int,
        records: int,
        measure: Callable[[jax.Array, jax.Array], Any] | None = None,
    ) -> tuple[jax.Array, jax.Array, Any]:
        """Integrate from time 0; pure, and differentiable in `params` in reverse.

        Memory of a derivative is that of `records` + `every` states, least where both
        are the square root of the steps. Bonds that break are frozen, see the module.

        Args:
            params: of the motion; its own by default.
            dt: time step (s), a number, not a traced one; not checked here, see
                `jaxpd.launch.longest_dt`.
            every: steps between records.
            records: how many; records * every steps in all.
            measure: called as measure(u, v) with displacements and velocities [n, d] at
                each record; a function made anew is compiled anew.

        Returns:
            u, v [n, d] at the end, and what was measured, [records, ...] each.
        """
        params = self.params if params is None else params
        if isinstance(dt, Tracer):
            raise ValueError("dt: a traced number; histories in time need a plain one")
        if not (dt > 0 and every > 0 and records > 0):
            raise ValueError(
                f"dt, every, records: {dt}, {every}, {records} must all be positive"
            )
        factors = self.course.factors(float(dt), 0, every * records)
        factors = jax.tree.map(lambda x: x.reshape(records, every, -1), factors)
        return _march(self, params, float(dt), factors, measure)


@partial(jax.jit, static_argnames=("measure",))
def _march(motion, params, dt, factors, measure):
    op, drive = motion.build(params)
    state = motion.first(op, params)

    @jax.checkpoint
    def record(state: State, factors: Any) -> tuple[State, Any]:
        state = verlet(op, drive, state, dt, factors)
        seen = None
        if measure is not None:
            seen = measure(op.pick(state.u), op.pick(state.v))
        return state, seen

    state, seen = jax.lax.scan(record, state, factors)
    return op.pick(state.u), op.pick(state.v), seen
