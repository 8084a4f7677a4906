"""Reasons in words: why a theory, an operator, a solver; README's table of them."""

from __future__ import annotations

#: Why an operator, a solver, a memory is taken: also README's table.
WHY = {
    "fft": "a lattice and small displacements: convolution, no index lists",
    "stencil": "a lattice: shifted slices, no index lists",
    "gather": "points that are no lattice, numbers of their own a bond, or points "
    "made of others: index lists",
    "weak": "kernels: one sparse matrix, assembled",
    "strong": "derivatives at nodes: one sparse matrix, not symmetric",
    "halves": "elastic bonds on a lattice: each bond once, one bit a bond",
    "slots": "elastic bonds of any points: sorted index lists",
    "memory": "a law with a memory of its own, or fading bonds",
    "stack": "plies each with the operator that suits it, and ghosts between",
    "springs": "bonds in equilibrium as springs",
    "d-pcg": "compiles least, and the system is small or well conditioned",
    "spectral": "few iterations by sines and cosines, little to compile",
    "multigrid": "few iterations whatever the size; its compilation pays here",
    "amg": "few iterations where points are no lattice, or bonds not alike",
    "direct": "small enough for sparse factors, which compile nothing",
}
#: What a scene has, the theory that it asks for, and how that is run.
THEORIES = (
    ("a crack, at rest", "bonds", "`solve_static`"),
    ("cracks that grow slowly", "bonds", "`solve_fracture`"),
    ("motion, with or without damage", "bonds", "`run_explicit`"),
    ("plies and thin layers between", "bonds, ghost interlayers", "`run_explicit`, "
     "`solve_static`"),
    ("smooth elasticity, any Poisson's ratio", "kernels, MLS difference",
     "`solve_static`"),
    ("plasticity, a memory of strain", "MLS difference, kernels", "`solve_path`"),
)  # fmt: skip
#: Words of `WHY` that name an operator; the others name solvers.
OPERATORS = ("fft", "stencil", "gather", "weak", "strong", "halves", "slots", "memory")


def which_when() -> str:
    """README's table of which method when: theories, operators, solvers; Markdown."""
    lines = ["| a scene with | theory | run by |", "|---|---|---|"]
    lines += [f"| {a} | {b} | {c} |" for a, b, c in THEORIES]
    lines += ["", "| operator or solver | taken for |", "|---|---|"]
    solvers = [name for name in WHY if name not in (*OPERATORS, "stack", "springs")]
    lines += [f'| `"{name}"` | {WHY[name]} |' for name in (*OPERATORS, *solvers)]
    return "\n".join(lines)
