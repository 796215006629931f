"""Numerical stability at the extremes: brownpipe, the note's loop, a plain event-driven code and
pymunk, same input.
"""
