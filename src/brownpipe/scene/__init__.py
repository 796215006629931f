"""Scenes: what is simulated. Their records, their files, sample times, and the seeds of runs."""

from brownpipe.scene.scene import Box, Disk, Scene, Species, Velocities
from brownpipe.scene.scene_file import parse_scene, read_scene, scene_yaml

__all__ = ["Box", "Disk", "Scene", "Species", "Velocities", "parse_scene", "read_scene", "scene_yaml"]
