"""Weak forms where they once went wrong: curved supports, odd laws, outlines."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd import (
    RKPM,
    Elastic,
    Scene,
    above,
    ball,
    below,
    moves,
    outlined,
    solve_static,
    traction,
    union,
)
from jaxpd.geometry import mapped
from jaxpd.geometry.outline import polygon_moments
from jaxpd.prepare import prepare


def disk(m=12):
    """Nodes around a circle and inside it."""
    t = 2.0 * np.pi * np.arange(m) / m
    g = np.linspace(-1.0, 1.0, 7)
    inner = np.stack(np.meshgrid(g, g), -1).reshape(-1, 2)
    inner = inner[np.linalg.norm(inner, axis=1) < 0.75]
    X = np.concatenate([np.stack([np.cos(t), np.sin(t)], 1), inner])
    return outlined(X, [np.arange(m)])


def test_linear_patch_of_a_held_curve():
    """Each chord is a straight run of two nodes."""
    body, m = disk(), 12

    def exact(a):
        A = np.array([[0.1, 0.2], [-0.05, 0.3]])
        return lambda X: X @ A[a] + 0.03

    around = union(*[ball(tuple(x), 1e-6) for x in np.asarray(body.X)[:m]])
    scene = Scene(
        body,
        Elastic(1.0, 0.3, "plane stress"),
        supports=[moves(around, x=exact(0), y=exact(1))],
        resolution=RKPM(),
    )
    X, u = np.asarray(body.X), np.asarray(solve_static(scene).u)
    assert np.abs(u - np.stack([exact(0)(X), exact(1)(X)], 1)).max() < 1e-13


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Skewed:
    """Stress linear in strain, but without an energy."""

    shear: float = 0.4

    def history0(self):
        return ()

    def step(self, strain, history):
        C = [[1.1, 1.0, 0.0], [0.1, 1.1, 0.0], [0.2, 0.0, self.shear]]
        return jnp.asarray(C) @ strain, history


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_gradient_with_a_law_that_is_not_symmetric():
    scene = Scene(
        mapped((5, 4), lambda s: s, jitter=0.2, seed=1),
        Skewed(),
        supports=[moves(below(x=0.0), x=0.0, y=0.0)],
        loads=[traction(above(x=1.0), x=0.01, y=0.01)],
        resolution=RKPM(),
    )
    problem = prepare(scene)
    rng = np.random.default_rng(0)
    weight, t = rng.normal(size=(20, 2)), problem.params["traction"]
    way = 0.01 * rng.normal(size=t.shape)

    @jax.jit
    def work(t):
        return jnp.sum(weight * problem.solve(problem.params | {"traction": t})[0])

    slope = float(jnp.sum(jax.grad(work)(t) * way))
    assert slope == pytest.approx(float(work(t + way) - work(t)), rel=1e-8)
    with pytest.raises(ValueError, match="material makes none"):
        prepare(scene, solver="amg")


def test_outlines_refuse_what_is_silently_wrong():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    X = np.concatenate([square, 0.25 + 0.5 * square])
    outer, hole = np.arange(4), np.array([7, 6, 5, 4])
    outlined(X, [outer, hole])
    outlined(np.concatenate([square, square + 2.0]), [outer, outer + 4])
    with pytest.raises(ValueError, match=r"number 1 of 4 nodes encloses 0\.25"):
        outlined(X, [outer, hole[::-1]])
    with pytest.raises(ValueError, match="number 1 of 2 nodes"):
        outlined(X[:6], [outer, [4, 5]])
    for place in ([0.5, 0.5], [1.5, 0.5]):
        with pytest.raises(ValueError, match=r"node 8 .* lies outside"):
            outlined(np.concatenate([X, [place]]), [outer, hole])


def test_area_far_from_the_origin():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    edge = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
    assert float(polygon_moments(square + 2.0**30, edge, 0)[0]) == 1.0
