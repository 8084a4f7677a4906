"""What the laws and conditions of a scene do: whether they break, remember, lock."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpd.laminate import Laminate
from jaxpd.nodes import is_projected, scheme_of
from jaxpd.physics import Hooke
from jaxpd.resolution import MLS
from jaxpd.scene import Elastic, Scene, Solid
from jaxpd.schedule import ALWAYS


def law_inside(material: Any) -> Any:
    """The law of a material; Hooke's of an `Elastic`."""
    return material.law if isinstance(material, Solid) else material


def elastic(material: Any) -> bool:
    """Whether a material is linear elastic, by constants."""
    return isinstance(material, Elastic) or isinstance(law_inside(material), Hooke)


def remembers(material: Any) -> bool:
    """Whether a law of nodes has a memory, as plastic strain."""
    law = law_inside(material)
    return hasattr(law, "history0") and not isinstance(law, Hooke)


def breaks(scene: Scene) -> bool:
    """Whether anything in a scene has a strength."""
    given = scene.material
    materials = given if isinstance(given, list | tuple) else [given]
    layers = scene.body.interlayers if isinstance(scene.body, Laminate) else ()
    return (
        any(getattr(one, "G0", None) is not None for one in materials)
        or any(
            isinstance(one, Solid)
            and (np.isfinite(one.s_crit) or hasattr(one.law, "advance"))
            for one in materials
        )
        or any(getattr(layer, "G0", None) is not None for layer in layers)
    )


def follows(scene: Scene) -> bool:
    """Whether a support or load follows a history."""
    return any(c.time != ALWAYS for c in (*scene.supports, *scene.loads))


def stiffening(scene: Scene) -> float:
    """Lame's constants lambda over mu of a body that is thick; 0 if it is thin."""
    law = law_inside(scene.material)
    nu, state = getattr(law, "nu", None), getattr(law, "state", "")
    if nu is None or state not in ("plane strain", "solid"):
        return 0.0
    most = min(float(np.max(np.asarray(nu))), 0.5 - 1e-9)
    return 2.0 * most / (1.0 - 2.0 * most)


def projected(scene: Scene) -> bool:
    """Whether changes of volume are smoothed over stars of the strong form."""
    resolution = scene.resolution
    if not isinstance(resolution, MLS):
        return False
    law = law_inside(scene.material)
    return is_projected(resolution.volume, law, scheme_of(resolution, scene.d))
