"""What asks for each key of a scene: the start of a run, forecasts, theory and words.

A key that theory or a forecast forgets gives wrong numbers without an error. Here each key is
changed in a scene, and the answers that change with it are compared with the row of the key in
CHANGES. A new key needs a row there; each of ANSWERS that ought to change with it, and does not, is
a function that must ask for it.
"""

from copy import deepcopy
from typing import Annotated, get_args, get_origin

import numpy as np
import pytest
from pydantic import BaseModel

from brownpipe.analysis import thermodynamics
from brownpipe.engines import confinement, forecast, friction, windows
from brownpipe.engines.exact.simulation import equilibrate, prepare_equilibration
from brownpipe.engines.start.initial_state import draw_state, draw_tracer, noise_stream
from brownpipe.observables import equilibrium
from brownpipe.report import description
from brownpipe.scene import motion, parse_scene
from brownpipe.scene.configuration import Configuration
from brownpipe.scene.scene import Scene


def velocities_at_start(scene):
    """The velocities (N, 2) of all disks at t = 0 in a run, after its time to equilibrate."""
    return equilibrate(prepare_equilibration(scene), draw_state(scene, 1)).velocity


def lone_tracer(scene):
    """Position and velocity (2, 2) of the tracer at t = 0 where it moves alone, among noise."""
    return np.array(draw_tracer(scene, 1, noise_stream(scene, 1)))


ANSWERS = {  # functions of a scene, by what they tell of it
    "drawn positions": lambda scene: draw_state(scene, 1).position,
    "drawn velocities": lambda scene: draw_state(scene, 1).velocity,
    "velocities at t = 0": velocities_at_start,
    "lone tracer": lone_tracer,
    "speed of the tracer": motion.mean_square_speed_of_tracer,
    "speed of the centre of mass": lambda scene: motion.mean_square_velocity_of_centre(scene).sum(),
    "temperature of the bath": motion.bath_temperature,
    "share of the bath": motion.bath_share,
    "speeds": forecast.speeds,
    "collisions of pairs": forecast.pair_rate,
    "collisions with walls": forecast.wall_rate,
    "seconds": lambda scene: forecast.run_cost(scene).seconds,
    "bytes": lambda scene: forecast.run_cost(scene).bytes_in_file,
    "settling": forecast.settling_time,
    "friction": lambda scene: friction.friction_rate(scene, "enskog"),
    "drift": friction.drift_diffusion,
    "walls": lambda scene: confinement.confinement(scene).pairs,
    "Enskog theory": lambda scene: [*thermodynamics.enskog(scene).values()],
    "windows": lambda scene: windows.default_windows([scene]),
    "stationary": equilibrium.why_not_stationary,
    "equilibrium": equilibrium.claims_equilibrium,
    "words on the disks": lambda scene: description.sentences(scene)["disks"],
    "words on the start": lambda scene: description.sentences(scene)["start"],
    "words on velocities": lambda scene: description.sentences(scene)["velocities"],
    "words on the run": lambda scene: description.sentences(scene)["run"],
}
OF_GIVEN_VELOCITIES = (  # the answers that a scene has in which nothing is drawn
    *("drawn positions", "drawn velocities", "velocities at t = 0", "speed of the tracer"),
    *("speed of the centre of mass", "speeds", "collisions of pairs", "collisions with walls"),
    *("seconds", "drift", "walls"),
)
SPECIES = {
    "box": {"x": [0.0, 4.0], "y": [0.0, 5.0], "boundary": "periodic"},
    "particles": 14,
    "disks": {
        "tracer": {"radius": 0.4, "mass": 3.0, "position": [2.0, 2.0]},
        "species": [
            {"name": "heavy", "count": 5, "radius": 0.3, "mass": 2.0},
            {"name": "light", "count": "rest", "radius": 0.2, "mass": 0.5},
        ],
        "placement": "random",
    },
    "velocities": {"temperature": 1.6, "zero_momentum": True},
    "equilibrate": {"time": 1.0, "tracer": "free"},
    "duration": 8.0,
    "sample_interval": 0.1,
}
WALLS = SPECIES | {
    "box": {"x": [0.0, 4.0], "y": [0.0, 5.0]},
    "velocities": {"temperature": 1.6, "zero_momentum": False},
}
CHANNEL = SPECIES | {
    "box": {"x": [0.0, 4.0], "y": [0.0, 5.0], "boundary": {"x": "periodic", "y": "reflecting"}},
}
HOT = WALLS | {"velocities": {"standard_deviation": 1.5}, "equilibrate": 0.0}
LOGARITHMIC = {key: value for key, value in SPECIES.items() if key != "sample_interval"}
LOGARITHMIC |= {"samples": {"per_decade": 5, "first": 0.01}}
LISTED = {
    "box": {"x": [0.0, 4.0], "y": [0.0, 5.0], "boundary": "periodic"},
    "disks": [
        {"position": [1.0, 1.0], "velocity": [1.0, 0.5], "radius": 0.3, "mass": 2.0},
        {"position": [3.0, 3.0], "velocity": [-1.0, 0.0], "radius": 0.4, "mass": 1.0},
    ],
    "duration": 8.0,
}
COLD = HOT | {
    "disks": WALLS["disks"] | {"tracer": {"radius": 0.4, "mass": 3.0, "velocity": [1.0, 0.0]}}
}
FILE = {  # as if it was read from one
    "box": {"x": [0.0, 4.0], "y": [0.0, 5.0], "boundary": "periodic"},
    "disks": {
        "configuration": Configuration(
            position=np.array([[1.0, 1.0], [3.0, 3.0], [1.0, 3.0]]),
            velocity=None,
            radius=np.array([0.4, 0.3, 0.3]),
            mass=np.array([3.0, 1.0, 1.0]),
        ),
        "tracer": {"mass": 3.0, "position": [1.0, 1.5], "velocity": [1.0, 0.0]},
        "species": {"kind-2": {"mass": 1.0}},
    },
    "velocities": {"temperature": 1.6},
    "duration": 8.0,
}
OTHER_PLACES = FILE["disks"]["configuration"]._replace(
    position=np.array([[1.0, 1.0], [3.0, 3.5], [1.0, 3.0]])
)
# What depends on the rates of collisions between disks
RATES = {"collisions of pairs", "seconds", "friction", "Enskog theory", "windows"}
WALL = "collisions with walls"
AT_START = "velocities at t = 0"
SIZE = RATES | {AT_START, WALL, "walls", "words on the disks"}  # on the radius of a species
SPEED = {"drawn velocities", AT_START, "speed of the centre of mass", "speeds", WALL}
MASS = RATES | SPEED | {"words on the disks"}  # on the mass of a species
HEAT = RATES | SPEED | {"temperature of the bath", "settling", "words on velocities"}
SAMPLES = {"seconds", "bytes", "words on the run"}
CHANGES = [  # key, scene, path to the key, another value of it, and the answers that change with it
    ("box.x", WALLS, ["box", "x"], [0.0, 6.0], SIZE | {"drawn positions", "settling"}),
    ("box.y", WALLS, ["box", "y"], [0.0, 6.0], SIZE | {"drawn positions", "settling"}),
    ("box.boundary", SPECIES, ["box", "boundary"], "reflecting",
     {"drawn positions", AT_START, "share of the bath", "collisions of pairs", WALL, "seconds",
      "walls", "Enskog theory", "windows", "equilibrium", "words on the disks",
      "words on the start"}),
    ("box.boundary.x", CHANNEL, ["box", "boundary", "x"], "reflecting",
     {"drawn positions", AT_START, "lone tracer", "speed of the tracer",
      "speed of the centre of mass", "share of the bath", "collisions of pairs", WALL, "seconds",
      "walls", "Enskog theory", "windows", "equilibrium", "words on the disks",
      "words on the start", "words on velocities"}),
    ("box.boundary.y", CHANNEL, ["box", "boundary", "y"], "periodic",
     {"drawn positions", AT_START, "lone tracer", "speed of the tracer",
      "speed of the centre of mass", "collisions of pairs", WALL, "seconds", "walls",
      "words on the disks",
      "words on velocities"}),
    ("particles", WALLS, ["particles"], 20,
     SIZE | {"drawn positions", "drawn velocities", "lone tracer", "speed of the centre of mass",
             "settling"}),
    ("disks.tracer.radius", WALLS, ["disks", "tracer", "radius"], 0.5, SIZE),
    ("disks.tracer.mass", WALLS, ["disks", "tracer", "mass"], 6.0,
     MASS | {"lone tracer", "speed of the tracer"}),
    ("disks.tracer.position", WALLS, ["disks", "tracer", "position"], [1.0, 2.0],
     {"drawn positions", AT_START, "lone tracer", "words on the disks"}),
    ("disks.species.count", WALLS, ["disks", "species", 0, "count"], 8,
     SIZE | {"drawn positions", "drawn velocities", "speed of the centre of mass"}),
    ("disks.species.radius", WALLS, ["disks", "species", 0, "radius"], 0.25,
     SIZE | {"drawn positions"}),
    ("disks.species.mass", WALLS, ["disks", "species", 0, "mass"], 1.0, MASS | {"settling"}),
    ("disks.placement", WALLS, ["disks", "placement"], "lattice",
     {"drawn positions", AT_START, "seconds", "settling", "words on the start"}),
    ("velocities.temperature", WALLS, ["velocities", "temperature"], 2.6,
     HEAT | {"lone tracer", "speed of the tracer"}),
    ("velocities.standard_deviation", HOT, ["velocities", "standard_deviation"], 2.0,
     (HEAT | {"lone tracer", "speed of the tracer"}) - {"Enskog theory"}),
    ("velocities.zero_momentum", SPECIES, ["velocities", "zero_momentum"], False,
     {AT_START, "lone tracer", "speed of the tracer", "speed of the centre of mass",
      "share of the bath", "drift",
      "Enskog theory", "windows", "words on velocities"}),
    ("equilibrate.time", WALLS, ["equilibrate", "time"], 2.0,
     {AT_START, "seconds", "words on the start"}),
    ("equilibrate.tracer", WALLS, ["equilibrate", "tracer"], "pinned",
     {AT_START, "stationary", "equilibrium", "words on the start"}),
    ("duration", WALLS, ["duration"], 16.0, SAMPLES | {"windows"}),
    ("sample_interval", WALLS, ["sample_interval"], 0.2, SAMPLES),
    ("samples.per_decade", LOGARITHMIC, ["samples", "per_decade"], 10, SAMPLES),
    ("samples.first", LOGARITHMIC, ["samples", "first"], 0.001, SAMPLES),
    ("disks.tracer.velocity", COLD, ["disks", "tracer", "velocity"], [2.0, 0.0],
     {"drawn velocities", AT_START, "lone tracer", "speed of the tracer",
      "speed of the centre of mass", "speeds", "collisions of pairs", WALL, "seconds",
      "words on velocities"}),
    ("velocities.distribution", HOT, ["velocities", "distribution"], "uniform",
     {"drawn velocities", AT_START, "lone tracer", "words on velocities"}),
    ("disks.configuration", FILE, ["disks", "configuration"], OTHER_PLACES, {"drawn positions"}),
    ("position of the tracer in a file", FILE, ["disks", "tracer", "position"], [1.0, 1.25],
     {"drawn positions", "lone tracer", "words on the disks"}),
    ("velocity of the tracer in a file", FILE, ["disks", "tracer", "velocity"], [2.0, 0.0],
     {"drawn velocities", AT_START, "lone tracer", "speed of the tracer", "speeds",
      "collisions of pairs", "seconds", "words on velocities"}),
    ("mass of the tracer in a file", FILE, ["disks", "tracer", "mass"], 5.0,
     (RATES | SPEED | {"share of the bath", "words on the disks"})
     - {"Enskog theory", "windows", WALL, "speed of the centre of mass"}),
    ("mass of a species in a file", FILE, ["disks", "species", "kind-2", "mass"], 2.0,
     (RATES | SPEED | {"share of the bath", "words on the disks"})
     - {"Enskog theory", "windows", WALL, "speed of the centre of mass"}),
    ("radius of a species in a file", FILE, ["disks", "species", "kind-2", "radius"], 0.25,
     (RATES | {"words on the disks"}) - {"Enskog theory", "windows"}),
    ("disks.position", LISTED, ["disks", 0, "position"], [1.5, 1.0], {"drawn positions"}),
    ("disks.velocity", LISTED, ["disks", 0, "velocity"], [2.0, 0.0],
     {"drawn velocities", AT_START, "speed of the tracer", "speed of the centre of mass", "speeds",
      "drift",
      "collisions of pairs", "seconds"}),
    ("disks.radius", LISTED, ["disks", 0, "radius"], 0.35,
     {"collisions of pairs", "seconds"}),
    ("disks.mass", LISTED, ["disks", 0, "mass"], 3.0,
     {"speed of the centre of mass", "speeds", "collisions of pairs", "seconds", "drift"}),
]  # fmt: skip
WITHOUT_A_ROW = {
    # no answer depends on a name
    "disks.species",
    "disks.species.name",
    # what is in the file counts
    "disks.file",
    "disks.seed",
    "disks.time",
    # it decides whether overlaps are refused
    "disks.push_apart",
}


def answers(mapping):
    """The answers to a scene by name."""
    scene = parse_scene(mapping, "keys.yaml")
    names = OF_GIVEN_VELOCITIES if scene.has_one_state else ANSWERS
    return {name: ANSWERS[name](scene) for name in names}


def with_value(mapping, path, value):
    """A copy of nested mappings and lists with another value at a path of keys and indices."""
    copy = deepcopy(mapping)
    *outer, last = path
    innermost = copy
    for key in outer:
        innermost = innermost[key]
    innermost[last] = value
    return copy


def is_same(before, after):
    """Whether two answers are equal: texts, or numbers of which some may be NaN."""
    if isinstance(before, (str, type(None))):
        return before == after
    return np.array_equal(before, after, equal_nan=True)


@pytest.mark.parametrize(("path", "mapping", "value", "expected"), [
    pytest.param(path, mapping, value, expected, id=key)
    for key, mapping, path, value, expected in CHANGES
])  # fmt: skip
def test_answers_that_depend_on_a_key_change_with_it(path, mapping, value, expected):
    before = answers(mapping)
    after = answers(with_value(mapping, path, value))
    changed = {name for name in before if not is_same(before[name], after[name])}
    assert changed == expected


def keys_of(model, path=()):
    """The keys of a mapping of scene files that hold values, like `disks.tracer.mass`."""
    for name, field in model.model_fields.items():
        inner = mappings_in(field.annotation)
        for mapping in inner:
            yield from keys_of(mapping, (*path, name))
        if not inner:
            yield ".".join((*path, name))


def mappings_in(annotation):
    """The mappings that the value of a key may be, or may have in it."""
    if isinstance(annotation, type):
        return [annotation] if issubclass(annotation, BaseModel) else []
    kinds = get_args(annotation)
    if get_origin(annotation) is Annotated:
        kinds = kinds[:1]
    return [mapping for kind in kinds for mapping in mappings_in(kind)]


def test_every_key_has_a_row():
    rows = {key for key, *_ in CHANGES}
    lacking = set(keys_of(Scene)) - rows - WITHOUT_A_ROW
    assert not lacking, f"CHANGES needs a row for each of {sorted(lacking)}"
