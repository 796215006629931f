"""Brownian motion from first principles: hard disks that collide exactly, a heavy one among them that wanders."""
