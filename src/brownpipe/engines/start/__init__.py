"""How a run starts: positions and velocities drawn from its seed."""
