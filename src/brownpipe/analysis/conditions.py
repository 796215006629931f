"""Properties of the scene: box, disks, initial state of the tracer. No run is needed."""

import numpy as np
from numpy.typing import ArrayLike

from brownpipe.analysis.estimator import Averages, Case, Columns, Estimator
from brownpipe.analysis.variables import EACH, SPEED2, Variable
from brownpipe.engines.friction import diffusive_from
from brownpipe.scene import Scene

CENTRED = 1e-12  # relative distance from the centre, or difference of the sides, that counts as round-off


def initial_square_speed(scene: Scene) -> float:
    """Return <v0^2> [length^2/time^2] of the tracer as the scene prescribes it: the coefficient of ballistic flight.

    2 s^2 for components of standard deviation s, 2 kT/m for a temperature, the squared speed of explicit disks. With
    zero total momentum the subtracted centre-of-mass velocity is accounted for. NaN if it is not known beforehand:
    a tracer that exchanges energy before t = 0 with a bath of another temperature.
    """
    if scene.velocities is None:
        return float(np.square(scene.listed[0].velocity).sum()) if scene.listed else np.nan
    if scene.equilibrate.time and scene.equilibrate.tracer == "free" and scene.velocities.temperature is None:
        return np.nan
    share = scene.mass / scene.mass.sum()
    if scene.velocities.temperature is None:
        still = 1 - 2 * share[0] + (share**2).sum() if scene.velocities.zero_momentum else 1.0
        return 2.0 * scene.velocities.standard_deviation**2 * still
    still = 1 - share[0] if scene.velocities.zero_momentum else 1.0
    return 2.0 * scene.velocities.temperature / scene.mass[0] * still


def accessible_half_width(scene: Scene) -> float:
    """Return half the side [length] of the square accessible to the tracer's centre; NaN if it starts elsewhere.

    Needed for diffusion in a reflecting square (docs/theory.md, section 2), which is solved for a start in its centre.
    """
    box, start = scene.box, next((disk.position for disk in scene.listed or scene.species), None)
    moved = scene.equilibrate.time > 0 and scene.equilibrate.tracer == "free"
    if box.periodic or moved or start is None or abs(box.width - box.height) > CENTRED * box.width:
        return np.nan
    off_centre = np.abs(np.array(start) - [sum(box.x) / 2, sum(box.y) / 2]).max()
    half_width = (box.width - 2 * scene.radius[0]) / 2
    return half_width if off_centre <= CENTRED * box.width and half_width > 0 else np.nan


def _derived(case: Case, averages: Averages) -> dict[str, ArrayLike]:
    scene = case.scene
    return {
        "box_width": scene.box.width,
        "duration": case.times[-1],
        "packing_fraction": scene.packing_fraction,
        "initial_square_speed": initial_square_speed(scene),
        "diffusive_from": diffusive_from(scene),
        "accessible_half_width": accessible_half_width(scene),
    }


VARIABLES = {
    "box_width": Variable(EACH, "length", "width of the box"),
    "duration": Variable(EACH, "time", "duration of a run"),
    "packing_fraction": Variable(EACH, "1", "packing fraction, share of the area covered by disks"),
    "initial_square_speed": Variable(EACH, SPEED2, "expected <v0^2> of the tracer: the MSD begins as <v0^2> t^2"),
    "diffusive_from": Variable(EACH, "time", "3/gamma of the tracer (Enskog): lines may be fitted to the MSD after it"),
    "accessible_half_width": Variable(
        EACH, "length", "half the side of the tracer's square, if it starts in its centre"
    ),
}
ESTIMATOR = Estimator(lambda case, runs: Columns(), VARIABLES, _derived)
