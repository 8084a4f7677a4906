"""Slow fracture: bodies that break, from one equilibrium to the next.

In the order in which data walks through: `breaking` prepares a scene as springs that
may fail; `live` and `live_iterative` hold a body that loses springs in equilibrium;
`states` keeps what is seen; `events` and `steps` decide what breaks next; `soft*` do
all that for bonds that soften; `retrace` and `soft_replay` are paths as functions of
the parameters; `growth` is the result, `solve` the door, `measures` and `trapping` look
back.
"""

from jaxpd.fracture.breaking import Fracture, prepare_fracture
from jaxpd.fracture.growth import Growth, Unfinished
from jaxpd.fracture.measures import Compliance, Toughness, straight_cuts, toughness
from jaxpd.fracture.solve import solve_fracture
from jaxpd.fracture.trapping import Trapping, trapping

__all__ = [
    "Compliance",
    "Fracture",
    "Growth",
    "Toughness",
    "Trapping",
    "Unfinished",
    "prepare_fracture",
    "solve_fracture",
    "straight_cuts",
    "toughness",
    "trapping",
]
