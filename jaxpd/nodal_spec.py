"""How a scene of nodes is modelled and solved, in the strong or the weak form."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.assembly import Params
from jaxpd.schedule import ALWAYS, Table
from jaxpd.solvers.newton import Newton


@dataclass(frozen=True)
class NodalSpec:
    """How a scene of nodes is modelled and solved; hashable, static under `jit`.

    Attributes:
        tangent: of the law, "ad", "hand" or "continuum".
        newton: settings of the nonlinear solve.
        supports: histories of the prescribed displacements.
        loads: histories of the loads.
        linear: whether the law is linear elastic.
        memory: whether the law has one.
        operator: "strong" or "weak".
        kinematics: "small".
    """

    tangent: str
    newton: Newton
    supports: tuple[Table, ...]
    loads: tuple[Table, ...]
    linear: bool
    memory: bool
    operator: str = "strong"
    kinematics: str = "small"

    def factors(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Factors of the histories of supports [q] and loads [r] at a time. Host."""
        supports, loads = self.supports, self.loads
        return np.array([f(t) for f in supports]), np.array([f(t) for f in loads])

    def check_static(self) -> None:
        """Refuse what one step from rest cannot have.

        Raises:
            ValueError: if the law has a memory, or conditions follow histories.
        """
        if self.memory:
            raise ValueError(
                "material: its law has a memory, so that the way counts; use "
                "solve_path(scene, times) with loads and supports that have a `time`"
            )
        if any(t != ALWAYS for t in (*self.supports, *self.loads)):
            raise ValueError(
                "supports, loads: their histories are for solve_path(scene, times)"
            )

    def with_newton(self, **settings: Any) -> NodalSpec:
        """This with other settings of Newton's method."""
        return dataclasses.replace(
            self, newton=dataclasses.replace(self.newton, **settings)
        )


def check_params(params: Params, known: Params) -> None:
    """Refuse parameters that are not those of a problem.

    Raises:
        ValueError: naming what is too much and what is missing.
    """
    if set(params) != set(known):
        unknown = sorted(set(params) - set(known))
        missing = sorted(set(known) - set(params))
        inner = [name for name in unknown if hasattr(known.get("law"), name)]
        where = f"; {inner} are fields of params['law']" if inner else ""
        raise ValueError(
            f"params: {unknown} must be absent and {missing} given, as in "
            f"`problem.params | {{name: value}}`{where}"
        )
