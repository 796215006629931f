"""Scenes: what is simulated. Their sections, which are the format of their files, sample times, and
seeds of runs.
"""

from brownpipe.scene.scene import Scene, parse_scene
from brownpipe.scene.sections import Box, Disk, Species, Tracer, Velocities

__all__ = ["Box", "Disk", "Scene", "Species", "Tracer", "Velocities", "parse_scene"]
