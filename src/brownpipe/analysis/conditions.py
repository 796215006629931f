"""What the scene alone says: box, disks, and how the tracer starts. No run is looked at."""

import numpy as np

from brownpipe.analysis.measure import Columns, Measure
from brownpipe.analysis.variables import EACH, SPEED2, Variable

CENTRED = 1e-12  # relative distance from the centre, and difference of sides, that is round-off


def initial_square_speed(scene):
    """<v0^2> [length^2/time^2] of the tracer as the scene prescribes it: the coefficient of ballistic flight.

    2 s^2 for components of standard deviation s, 2 kT/m for a temperature, the speed itself for explicit disks. Without
    total momentum the tracer shares in the common velocity that is taken away. NaN if it is not known beforehand: a
    tracer that exchanges energy before t = 0 in a bath of another temperature.
    """
    if scene.velocities is None:
        return float(np.square(scene.disks[0].velocity).sum()) if scene.disks else np.nan
    if scene.equilibrate and scene.tracer_while_equilibrating == "free" and scene.velocities.temperature is None:
        return np.nan
    share = scene.mass / scene.mass.sum()
    if scene.velocities.temperature is None:
        still = 1 - 2 * share[0] + (share**2).sum() if scene.velocities.zero_momentum else 1.0
        return 2.0 * scene.velocities.standard_deviation**2 * still
    still = 1 - share[0] if scene.velocities.zero_momentum else 1.0
    return 2.0 * scene.velocities.temperature / scene.mass[0] * still


def start(scene):
    """Where the tracer is at t = 0 [length], (2,); NaN where it is left to chance."""
    moved = scene.equilibrate > 0 and scene.tracer_while_equilibrating == "free"
    first = next(iter(scene.disks or scene.species), None)
    if first is None or first.position is None or moved:
        return np.full(2, np.nan)
    return np.array(first.position, float)


def accessible(scene, radius):
    """Width and height [length] of the rectangle for the centre of a disk of `radius`: all of a periodic box."""
    inset = 0.0 if scene.box.periodic else 2 * radius
    return scene.box.width - inset, scene.box.height - inset


def accessible_half_width(scene):
    """Half the side [length] of the square in which the tracer's centre moves, if it starts in its middle; else NaN."""
    box = scene.box
    middle = np.array([sum(box.x) / 2, sum(box.y) / 2])
    centred = np.all(np.abs(start(scene) - middle) <= CENTRED * box.width)
    if box.periodic or not centred or abs(box.width - box.height) > CENTRED * box.width:
        return np.nan
    half_width = (box.width - 2 * scene.radius[0]) / 2
    return half_width if half_width > 0 else np.nan


def _estimate(case, found):
    scene, (x, y) = case.scene, start(case.scene)
    return {
        "box_width": scene.box.width,
        "box_height": scene.box.height,
        "periodic": scene.box.periodic,
        "duration": case.times[-1],
        "packing_fraction": scene.packing_fraction,
        "initial_square_speed": initial_square_speed(scene),
        "tracer_radius": scene.radius[0] if scene.particles else np.nan,
        "start_x": x,
        "start_y": y,
        "accessible_half_width": accessible_half_width(scene),
    }


MEASURE = Measure(
    lambda case, runs: Columns(),
    _estimate,
    {
        "box_width": Variable(EACH, "length", "width of the box"),
        "box_height": Variable(EACH, "length", "height of the box"),
        "periodic": Variable(
            EACH, "1", "what bounds the box", np.int8, -1,
            {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "no_runs walls periodic"},
        ),
        "duration": Variable(EACH, "time", "duration of a run"),
        "packing_fraction": Variable(EACH, "1", "share of the box covered by disks"),
        "initial_square_speed": Variable(EACH, SPEED2, "expected <v0^2> of the tracer: the MSD begins as <v0^2> t^2"),
        "tracer_radius": Variable(EACH, "length", "radius of the tracer"),
        "start_x": Variable(EACH, "length", "where the tracer starts, horizontally, unless left to chance"),
        "start_y": Variable(EACH, "length", "where the tracer starts, vertically, unless left to chance"),
        "accessible_half_width": Variable(
            EACH, "length", "half the side of the square of the tracer's centre, if it starts in its middle"
        ),
    },
)  # fmt: skip
