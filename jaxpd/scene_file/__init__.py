"""Scenes as files: what Python would say, in TOML, strictly read.

words    functions that a file may call, and what their arguments are
read     `load_scene`: keys and values that are not known are refused by name
write    `save_scene`: a scene that is data, written
"""

from jaxpd.scene_file.read import SceneFile, load_scene, parse_scene
from jaxpd.scene_file.write import save_scene

__all__ = ["SceneFile", "load_scene", "parse_scene", "save_scene"]
