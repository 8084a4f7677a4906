"""Schemes of integration of a weak form on nodes, by name: data alone.

| name   | places                | gradients                        | passes     | K   |
|--------|-----------------------|----------------------------------|------------|-----|
| QCNI   | 3 in each node's cell | linear in the cell               | quadratic  | sym |
| SCNI   | the node's cell       | constant in the cell             | linear     | sym |
| NI     | nodes                 | direct                           |            | sym |
| NIS    | nodes                 | direct, residual stabilisation   |            | sym |
| NSNI   | nodes                 | direct, natural stabilisation    |            | sym |
| MNI    | circles, 2 x 6        | direct: the scheme of paper 004  |            | sym |
| VC-MNI | circles, 2 x 6        | test gradients consistent        | linear     |     |
| V2-MNI | circles, 2 x 6        | test gradients consistent        | quadratic  |     |
| Q2-MNI | circles, 1 x 4        | projected, trial and test        | quadratic  | sym |
| GI     | 12 in each triangle   | direct: background cells         |            | sym |
| QC3    | 3 in each triangle    | test gradients consistent        | quadratic  |     |

QCNI and Q2-MNI pass that of second order where held edges lie on straight runs of three
nodes or more; on shorter ones (chords of a curve) QCNI passes the linear one.

QCNI: Duan, Wang, Gao, Li, Comput. Mech. 54 (2014) 353-368, here with three places a
cell for their nodal values and slopes, so that any law may be sampled. SCNI: Chen, Wu,
Yoon, You, Int. J. Numer. Meth. Engng 50 (2001) 435-466. NIS: Beissel, Belytschko,
Comput. Methods Appl. Mech. Engrg 139 (1996) 49-74. NSNI: Hillman, Chen, Int. J. Numer.
Meth. Engng 107 (2016) 603-630. VC: Chen, Hillman, Rueter, ibid. 95 (2013) 387-418.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Scheme:
    """How a weak form is sampled.

    Attributes:
        rule: where, one of `jaxpd.discretize.quadrature.RULES`.
        gradient: "direct", or in cells of nodes "constant" or "linear".
        correction: "none"; "test", of the test gradients alone; "both", a projection.
        order: degree of the stresses that corrected gradients are consistent with.
        stabilisation: "none", "residual" or "natural".
        points: of circles along radius and angle; of a triangle, and 0; 1 for the
            centroid of a cell alone.
        volumes: of nodes, "spacing" or "cells".
        exact: whether weights integrate polynomials of degree 2 over the body.
        passes: degree of the patch tests that it is to pass on any nodes, 0 for none;
            `tests/test_schemes.py` holds every scheme to it.
    """

    rule: str
    gradient: str = "direct"
    correction: str = "none"
    order: int = 1
    stabilisation: str = "none"
    points: tuple[int, int] = (2, 6)
    volumes: str = "spacing"
    exact: bool = False
    passes: int = 0

    def __post_init__(self):
        """Refuse what does not go together."""
        if self.gradient != "direct" and self.rule != "cells":
            raise ValueError(
                f"gradient: {self.gradient!r} is for the rule 'cells', and the rule is "
                f"{self.rule!r}"
            )
        if self.gradient == "linear" and self.points[0] == 1:
            raise ValueError(
                "points: 1 place a cell does not see a linear gradient; leave it out"
            )

    @property
    def symmetric(self) -> bool:
        """Whether trial and test gradients are the same."""
        return self.correction != "test"


SCHEMES = {
    "QCNI": Scheme("cells", "linear", passes=2),
    "SCNI": Scheme("cells", "constant", points=(1, 0), passes=1),
    "NI": Scheme("nodes"),
    "NIS": Scheme("nodes", stabilisation="residual"),
    "NSNI": Scheme("nodes", stabilisation="natural"),
    "MNI": Scheme("circles"),
    "VC-MNI": Scheme("circles", correction="test", order=0, passes=1),
    "V2-MNI": Scheme("circles", correction="test", exact=True, passes=2),
    "Q2-MNI": Scheme("circles", correction="both", points=(1, 4), exact=True, passes=2),
    "GI": Scheme("triangles", points=(12, 0)),
    "QC3": Scheme("triangles", correction="test", points=(3, 0), passes=2),
}
