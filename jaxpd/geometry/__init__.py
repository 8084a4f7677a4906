"""Points, families and cracks: topology on the host, everything else traced."""

from jaxpd.geometry.cloud import Cloud, Lattice, from_points, lattice
from jaxpd.geometry.connectivity import (
    free_modes,
    grid_loose_points,
    grid_pieces,
    loose_points,
    pieces,
    rigid_modes,
)
from jaxpd.geometry.crack import Crack, rectangle, segment
from jaxpd.geometry.family import Family, find
from jaxpd.geometry.grid_family import GridFamily, find_on_grid, without
from jaxpd.geometry.mapped import box_nodes, mapped
from jaxpd.geometry.mesh import from_mesh, read_points
from jaxpd.geometry.outline import outlined
from jaxpd.geometry.region import (
    Ball,
    Box,
    HalfSpace,
    Region,
    Union,
    above,
    ball,
    below,
    box,
    union,
)
from jaxpd.geometry.rim import Rim, rim, row_normals

__all__ = [
    "Ball",
    "Box",
    "Cloud",
    "Crack",
    "Family",
    "GridFamily",
    "HalfSpace",
    "Lattice",
    "Region",
    "Rim",
    "Union",
    "above",
    "ball",
    "below",
    "box",
    "box_nodes",
    "find",
    "find_on_grid",
    "free_modes",
    "from_mesh",
    "from_points",
    "grid_loose_points",
    "grid_pieces",
    "lattice",
    "loose_points",
    "mapped",
    "outlined",
    "pieces",
    "read_points",
    "rectangle",
    "rigid_modes",
    "rim",
    "row_normals",
    "segment",
    "union",
    "without",
]
