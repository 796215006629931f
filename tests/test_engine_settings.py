"""What a setting of an engine must reach: the runs, forecast and words that it changes, labels and
files, the manual.

A setting that a simulation forgets gives the runs of its default, without an error. Here each
setting takes a second value, and the answers that change with it are compared with its row in
CHANGES. A new setting needs a row there; each of ANSWERS that ought to change with it, and does
not, is a function that must use it.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from brownpipe.engines import DEFINITIONS, engine_of_record, engine_of_request
from brownpipe.scene import parse_scene

MANUAL = (Path(__file__).parents[1] / "config" / "README.md").read_text()
SCENE = parse_scene(
    {
        "box": {"x": [0.0, 4.0], "y": [0.0, 4.0], "boundary": "periodic"},
        "particles": 30,
        "disks": {
            "tracer": {"radius": 0.3, "mass": 4.0},
            "species": [{"name": "bath", "count": "rest", "radius": 0.2, "mass": 1.0}],
        },
        "velocities": {"temperature": 1.0},
        "duration": 1.0,
        "sample_interval": 0.25,
    },
    "few.yaml",
)
RECORD = frozenset({"tracer"})
ANSWERS = {  # of an engine, by what they tell
    "runs": lambda engine: engine.simulate(SCENE, [0, 1], RECORD).tracer.position,
    "seconds": lambda engine: engine.forecast(SCENE, RECORD, (), "runs").seconds,
    "words on the model": lambda engine: engine.model([SCENE]),
}
CHANGES = {  # engine, setting: two values, other settings, the answers that change
    ("timestep", "time_step"): ((0.01, 0.02), {}, {"runs", "seconds"}),
    ("timestep", "collisions"): (("at_contact", "late"), {"time_step": 0.02}, {"runs"}),
    ("langevin", "friction"): (("enskog", "boltzmann"), {}, {"runs", "words on the model"}),
}
SETTINGS = [
    (name, setting)
    for name, definition in DEFINITIONS.items()
    for setting in definition.settings._fields
]


@pytest.fixture(params=SETTINGS, ids="-".join)
def pair(request):
    """A setting, and engines with two values of it."""
    name, setting = request.param
    assert request.param in CHANGES, f"{setting} of {name}: needs a row in CHANGES"
    values, others, _ = CHANGES[request.param]
    engines = [engine_of_request(name, {setting: value, **others}) for value in values]
    return request.param, engines


def test_each_answer_that_depends_on_a_setting_uses_it(pair):
    key, engines = pair
    *_, expected = CHANGES[key]
    changed = set()
    for name, answer in ANSWERS.items():
        first, second = (answer(engine) for engine in engines)
        if not np.array_equal(first, second):
            changed.add(name)
    assert changed == expected


def test_engines_that_differ_in_a_setting_have_labels_and_records_of_their_own(pair):
    _, engines = pair
    labels = {engine.label for engine in engines}
    options = {engine.options for engine in engines}
    assert len(labels) == len(options) == 2
    for engine in engines:
        assert engine_of_record(engine.name, dict(engine.settings)) == engine


@pytest.mark.parametrize(("name", "setting"), SETTINGS)
def test_the_manual_has_each_setting_in_the_row_of_its_engine(name, setting):
    row = re.search(rf"^\| `{name}` \|.*$", MANUAL, re.MULTILINE)
    assert f"`{setting}`:" in row[0], f"{setting} of {name}: needs a place in config/README.md"
