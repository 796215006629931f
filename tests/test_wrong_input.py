"""Mistakes in scenes and studies: one line with file, line, key and what is allowed, from every way
in.
"""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import brownpipe as bp
from brownpipe.cli import main
from brownpipe.errors import WRONG_REQUEST, RequestError
from brownpipe.scene import Scene
from brownpipe.scene.reading import read_yaml, yaml_text
from brownpipe.storage.configurations import read_scene
from brownpipe.study import read_study

CONFIG = Path(__file__).parent.parent / "config"
SPECIES = """\
box:
  x: [-3, 3]
  y: [-3, 3]
particles: 150
disks:
  tracer: {radius: 0.3, mass: 1, position: [0, 0]}
  species:
  - {name: bath, count: rest, radius: 0.1, mass: 0.4}
velocities: {temperature: 1.6}
duration: 1
sample_interval: 0.1
"""
LISTED = """\
box: {x: [-3, 3], y: [-3, 3]}
duration: 1
disks:
- {position: [0, 0], velocity: [1, 0], radius: 0.1, mass: 1}
- {position: [1, 0], velocity: [1, 0], radius: 0.1, mass: 1}
"""
STUDY = f"""\
scenes:
- {CONFIG}/scenes/harrison2020.yaml
- {CONFIG}/scenes/harrison2020_thermal.yaml
particles: [50, 150]
engines:
- exact
- {{name: timestep, time_step: 0.001}}
seeds: 60
batch: 30
record: tracer
average: runs
observables: []
figures: [msd]
displacement_times: [0.5]
fit_windows:
- [0.1, 1]
rings: {{dr: 0.1, count: 20}}
allow_failed: 0
"""
SCENES = [  # of which text, what in it, is replaced by what; line, key, and a word of the message
    (SPECIES, "x: [-3, 3]", "x: [3, -3]", 2, "box.x", "low < high"),
    (SPECIES, "x: [-3, 3]", "x: [1, 2, 3]", 2, "box.x", "a list of at most 2"),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [-3, 3]\n  boundary: periodc",
        4,
        "box.boundary",
        "or 'periodic', not 'periodc'",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [0, 1]\n  boundary: periodic",
        7,
        "disks.tracer.radius",
        "to 0.25 in this periodic",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [-0.3, 0.3]\n  boundary: {x: periodic, y: reflecting}",
        7,
        "disks.tracer.radius",
        "below 0.3 by more than round-off, or the velocity along y 0, not 0.3: between walls in y",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [-3, 3]\n  boundary: {x: periodic}",
        4,
        "box.boundary.y",
        "missing; must be given",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [-3, 3]\n  boundary: {x: foo, y: periodic}",
        4,
        "box.boundary.x",
        "must be 'reflecting' or 'periodic', not 'foo'",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [-3, 3]\n  boundary: {x: periodic, z: reflecting}",
        4,
        "box.boundary.z",
        "unknown key; allowed: x, y",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [-3, 3]\n  boundary: [periodic, reflecting]",
        4,
        "box.boundary",
        "must be 'reflecting', 'periodic', or one of them for each of x and y, not ['periodic', ",
    ),
    (
        SPECIES,
        "y: [-3, 3]",
        "y: [0, 1]\n  boundary: {x: reflecting, y: periodic}",
        7,
        "disks.tracer.radius",
        "to 0.25 in this channel along y, not 0.3",
    ),
    (SPECIES, "particles: 150", "particles: -1", 4, "particles", "or equal to 0, not -1"),
    (SPECIES, "particles: 150", "N: 150", 4, "N", "did you mean particles? allowed: box,"),
    (
        SPECIES,
        "particles: 150",
        "particles: 2000",
        5,
        "disks",
        "2000 disks cover 1.752 times the area of the box",
    ),
    (SPECIES, "count: rest", "count: 5", 4, "particles", "must be 6"),
    (SPECIES, "count: rest", "count: rset", 8, "disks.species[0].count", "or 'rest', not 'rset'"),
    (SPECIES, "name: bath", "name: tracer", 7, "disks.species", "names of their own, none tracer"),
    (SPECIES, "name: bath", "name: ../bath", 8, "disks.species[0].name", "a name: letters"),
    (SPECIES, ", radius: 0.1, mass: 0.4", "", 8, "disks.species[0].radius", "and so must mass"),
    (SPECIES, "count: rest", "number: 70", 8, "disks.species[0].number", "did you mean count?"),
    (SPECIES, "velocities: {temperature: 1.6}\n", "", 1, "velocities", "missing; must be given w"),
    (SPECIES, "mass: 0.4", "mas: 0.4", 8, "disks.species[0].mas", "did you mean mass?"),
    (SPECIES, "mass: 0.4", "mass: 1e-210", 5, "disks", "within a factor of 1e+200"),
    (
        SPECIES,
        "radius: 0.3",
        "radius: 3.5",
        6,
        "disks.tracer.radius",
        "6e-10 to 3.0 in this reflecting box",
    ),
    (
        SPECIES,
        "radius: 0.3",
        "radius: 0,3",
        6,
        "disks.tracer.3",
        "unknown key; a number has a decimal point",
    ),
    (
        SPECIES,
        "1.6",
        "1, standard_deviation: 2",
        9,
        "velocities",
        "either standard_deviation or temperature",
    ),
    (
        SPECIES,
        "1.6",
        "1, zero_momentum: yes",
        9,
        "velocities.zero_momentum",
        "true or false, not 'yes'",
    ),
    (SPECIES, "duration: 1", "duration: .inf", 10, "duration", "a valid number, not '.inf'"),
    (
        SPECIES,
        "sample_interval: 0.1",
        "sample_interval: 1e-8",
        11,
        "sample_interval",
        "must be 1e-07 to 1 times",
    ),
    (SPECIES, "sample_interval: 0.1", "samples: {first: 0.1}", 11, "samples.per_decade", "missing"),
    (
        SPECIES,
        "sample_interval: 0.1",
        "samples: {per_decade: 2, first: 1}",
        11,
        "samples.first",
        "below the duration",
    ),
    (
        SPECIES,
        "0.1\n",
        "0.1\nsamples: {per_decade: 2}\n",
        12,
        "samples",
        "not be given with sample_interval",
    ),
    (SPECIES, "0.1\n", "0.1\nequilibrate: {tracer: free}\n", 12, "equilibrate.time", "missing"),
    (
        LISTED,
        "radius: 0.1",
        "radius: 0.95",
        3,
        "disks",
        "disk 0 at [0.0, 0.0] and disk 1 at [1.0, 0.0] overlap",
    ),
    (
        LISTED,
        LISTED.partition("disks:")[2],
        " {}\n",
        3,
        "disks",
        "must have a tracer or species, or be a list of",
    ),
    (
        LISTED,
        "disks:\n",
        "disks:\n- 3\n",
        4,
        "disks[0]",
        "keys position, velocity, radius, mass, species, not 3",
    ),
    (
        LISTED,
        "duration: 1",
        "duration: 1\nparticles: 3",
        3,
        "particles",
        "must be 2, the number of disks in",
    ),
    (
        LISTED,
        "duration: 1",
        "duration: 1\nvelocities: {temperature: 1}",
        6,
        "disks[1].velocity",
        "must not be given with `velocities`; disk 0 alone may",
    ),
    (
        LISTED,
        "duration: 1",
        "duration: 1\nequilibrate: {time: 1, tracer: pinned}",
        3,
        "equilibrate.tracer",
        "must be free, as there is no tracer",
    ),
    (
        LISTED,
        "y: [-3, 3]",
        "y: [-3, 0], boundary: periodic",
        4,
        "disks[0].position",
        "inside the box, -3 <= y < 0",
    ),
]
STUDIES = [
    ("seeds: 60\n", "", 1, "seeds", "must be given, or a tolerance in their place"),
    ("seeds: 60", "seeds: 9-3,5", 8, "seeds", "like 17, 0-2399 or 3,5,9, ascending, not '9-3,5'"),
    ("seeds: 60", "seeds: 0-99999999", 8, "seeds", "at most 10000000 seeds, not 100000000: '0-9"),
    ("seeds: 60", "seeds: 5-6,0-9999999", 8, "seeds", "at most 10000000 seeds, not 10000002"),
    ("seeds: 60", "seeds: 30000000", 8, "seeds", "at most 10000000 seeds, not 30000000"),
    ("seeds: 60", "seeds: [1000000000000000000]", 8, "seeds", "a seed must be at most 99999999999"),
    ("seeds: 60", 'seeds: "7,2000000000000000000"', 8, "seeds", "a seed must be at most 999999"),
    (
        "seeds: 60\nbatch: 30",
        "seeds: 10000\nbatch: 1",
        9,
        "batch",
        "at most 10000 jobs (80000 with this one)",
    ),
    ("seeds: 60", "seeds: 3\ntolerance: 2%", 8, "seeds", "or a tolerance in their place; not both"),
    ("seeds: 60", "tolerance: 0", 8, "tolerance", "must be greater than or equal to 0.000316"),
    ("seeds: 60", "tolerance: true", 8, "tolerance", "must be a valid number"),
    (
        "seeds: 60",
        "tolerance: 2%\ntarget: mds",
        9,
        "target",
        "'displacement_distribution', not 'mds'",
    ),
    ("particles: [50, 150]", "particles: [50, 50]", 4, "particles", "differ"),
    (
        "particles: [50, 150]",
        "particles: 2000",
        2,
        "scenes[0]",
        "line 9: disks: 2000 disks cover 1.752 times",
    ),
    (
        "scenes:\n",
        "scenes:\n- absent.yaml\n",
        2,
        "scenes[0]",
        "absent.yaml: cannot be read: No such file",
    ),
    ("harrison2020_thermal", "harrison2020", 1, "scenes", "values that differ"),
    (
        "harrison2020_thermal",
        "../scenes/harrison2020",
        3,
        "scenes[1]",
        "a name (file stem) of its own",
    ),
    ("- exact", "- exat", 6, "engines[0]", "'exact', 'timestep', 'langevin', not 'exat'"),
    ("- exact", "- {friction: enskog}", 6, "engines[0]", "must have the key 'name'"),
    (
        "- exact",
        "- {name: exact, time_step: 1}",
        6,
        "engines[0].time_step",
        "allowed: name, scenes, seeds",
    ),
    (
        "- exact",
        "- {name: exact, scenes: dense}",
        6,
        "engines[0].scenes",
        "harrison2020 or harrison2020_thermal",
    ),
    (
        "- exact",
        "- exact\n- {name: exact, seeds: 3}",
        5,
        "engines",
        "must be engines or settings that differ",
    ),
    ("time_step: 0.001", "time_step: 1", 7, "engines[1]", "time_step: must be at most 0.03484"),
    (
        "average: runs\nobs",
        "average: origins\nobs",
        11,
        "average",
        "origins needs square_displacement",
    ),
    (
        "observables: []",
        "observables: [species]",
        12,
        "observables[0]",
        "my_module:my_function, not 'species'",
    ),
    (
        "figures: [msd]",
        "panel: [scene, mass]",
        13,
        "panel",
        "must be scene or particles or engine, not 'mass'",
    ),
    ("figures: [msd]", "figures: energy", 13, "figures", "needs the observable species_energy"),
    (
        "displacement_times: [0.5]",
        "displacement_times: 0.333",
        14,
        "displacement_times[0]",
        "a sample time of some",
    ),
    (
        "record: tracer",
        "record: none",
        15,
        "fit_windows",
        "must go with record: tracer, or square_displacement",
    ),
    ("- [0.1, 1]", "- [0.1, 0.115]", 16, "fit_windows[0]", "three samples or more of harrison2020"),
    (
        "- [0.1, 1]",
        "- [0.1, 2]",
        16,
        "fit_windows[0]",
        "t0 < t1 <= 1.0 and three samples or more of harrison2020",
    ),
    ("- [0.1, 1]", "- [0.1, 1]\n- [0.1, 1]", 15, "fit_windows", "must be values that differ"),
    (", count: 20", "", 17, "rings.count", "missing"),
    (
        "allow_failed: 0",
        "instead_of: {harrison2020: harrison2020}",
        18,
        "instead_of.harrison2020",
        "other scenes with",
    ),
    (
        "allow_failed: 0",
        "instead_of: {harrison2020: dense}",
        18,
        "instead_of.harrison2020",
        "or harrison2020_thermal",
    ),
]
VARIED = [
    (
        "{disks.tracer.mass: [-1]}",
        "vary",
        "(replaced): disks.tracer.mass: must be greater than 0, not -1",
    ),
    ("{disks.species.b.mass: [1]}", "vary", "must be a key like disks.tracer.mass, or"),
    ("{packing_fraction: [1.5]}", "vary", "packing_fraction: must be less than or equal to 1"),
    ("{duration: [1, 1.0000000000001]}", "vary", "must be values that differ"),
    (
        "{disks.species.bath.count: [10.5]}",
        "vary",
        "species[0].count: must be a valid integer or 'rest', not 10.5",
    ),
    (
        "{disks.species.bath.count: {from: 2, to: 4, count: 5}}",
        "vary",
        "must be values that differ",
    ),
    ("{duration: {from: 1, to: 3}}", "vary.duration.count", "missing"),
    (
        "{duration: {from: -1, to: 3, count: 3, spacing: log}}",
        "vary.duration.from",
        "0 and of one sign",
    ),
    ("{particles: [16]}", "vary", "by the key `particles`"),
    (
        "{duration: [1, 2], box.x: [[0, 1]]}\nvary_together: true",
        "vary",
        "lists of the same length",
    ),
]
STUDIES += [("allow_failed: 0", f"vary: {new}", 18, key, word) for new, key, word in VARIED]
BOTH = [
    (b"", None, "empty; must be a mapping"),
    (b"just words\n", None, "must be a mapping of keys"),
    (b"\x89HDF\r\n\x1a\n", None, "not text; if it is an HDF5 file"),
    (b"a: [1, 2\n", 2, "not valid YAML"),
    (b"a: 1\n\tb: 2\n", 2, "a tab; YAML indents by spaces"),
    (b"box:\n  x: [0, 1]\n\ty: [0, 1]\n", 3, "a tab; YAML indents by spaces"),
    (b"a:\n\tb: 2\n", 2, "a tab; YAML indents by spaces"),
    (b"a: \x00", None, "not valid YAML"),
    (b"a: 1\n---\nb: 2\n", 2, "found another document"),
    (b"a: 1\nb: 2\na: 3\n", 3, "key 'a': must be a plain word, and given once"),
    (b"a: !!python/object/apply:os.system ['true']\n", 1, "a: unknown key"),
    (b"? [a, b]\n: 1\n", None, "line 1: key [ScalarNode"),
    (b"a: " + 5000 * b"1", None, "Exceeds the limit"),
    (b"a: " + 3000 * b"[", None, ""),
]


def refusal(path, read, capsys):
    """The line of a reader and of the command line, without the path; they are the same."""
    with pytest.raises(RequestError) as refused:
        read(path)
    line = str(refused.value)
    assert main(["check", str(path)]) == WRONG_REQUEST
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", f"brownpipe: {line}\n")
    assert "\n" not in line and line.startswith(f"{path}: ")
    return line.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    ("text", "old", "new", "line", "key", "word"), SCENES, ids=range(len(SCENES))
)
def test_wrong_scenes(tmp_path, capsys, text, old, new, line, key, word):
    assert old in text
    text = text.replace(old, new, 1)
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    message = refusal(path, read_scene, capsys)
    assert message.startswith(f"line {line}: {key}: ") and word in message
    keys = read_yaml(path)
    if keys.keys() <= Scene.model_fields.keys():
        with pytest.raises(RequestError) as refused:
            bp.Scene(**{"duration": None, **keys})
        assert str(refused.value).startswith(f"Scene: {key}: ")


@pytest.mark.parametrize(("old", "new", "line", "key", "word"), STUDIES, ids=range(len(STUDIES)))
def test_wrong_studies(tmp_path, capsys, old, new, line, key, word):
    assert old in STUDY
    path = tmp_path / "wrong.yaml"
    path.write_text(STUDY.replace(old, new, 1))
    message = refusal(path, read_study, capsys)
    assert message.startswith(f"line {line}: {key}: ") and word in message


@pytest.mark.parametrize(("content", "line", "word"), BOTH, ids=range(len(BOTH)))
def test_wrong_files(tmp_path, capsys, content, line, word):
    path = tmp_path / "wrong.yaml"
    path.write_bytes(content)
    for read in (read_scene, read_study):
        with pytest.raises(RequestError) as refused:
            read(path)
        start = f"{path}: " + (f"line {line}: " if line else "")
        assert str(refused.value).startswith(start) and word in str(refused.value)
    refusal(path, read_scene, capsys)


def test_the_texts_themselves_are_accepted(tmp_path):
    for text, read in ((SPECIES, read_scene), (LISTED, read_scene), (STUDY, read_study)):
        (tmp_path / "right.yaml").write_text(text)
        read(tmp_path / "right.yaml")


def test_files_that_cannot_be_read_or_have_no_name_for_results(tmp_path, capsys):
    assert (
        refusal(tmp_path / "absent.yaml", read_scene, capsys)
        == "cannot be read: No such file or directory"
    )
    assert refusal(tmp_path, read_scene, capsys) == "cannot be read: Is a directory"
    (tmp_path / "my scene.yaml").write_text(LISTED)
    assert "name: must be a name: " in refusal(tmp_path / "my scene.yaml", read_scene, capsys)


@pytest.mark.slow
@given(
    st.one_of(
        st.binary(max_size=40), st.text(alphabet="a:-[]{},&*!|>'\"%@? \n\t#0.1e", max_size=40)
    )
)
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_refused_in_one_line(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(RequestError, match=r"^[^\n]*$"):
        read_scene(path)


def test_a_value_of_the_command_line_has_no_line(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(STUDY)
    with pytest.raises(
        RequestError, match=r"study.yaml \(replaced\): batch: must be .* 1 or 'auto', not -1"
    ):
        read_study(path, {"batch": -1})
    path.write_text(STUDY.replace("record: tracer", "record: trace"))
    with pytest.raises(RequestError, match=r"study.yaml: line 10: record\[0\]: must be"):
        read_study(path, {"batch": 3})
    (tmp_path / "scene.yaml").write_text(LISTED)
    with pytest.raises(RequestError, match=r"scene.yaml \(replaced\): particles: must be 2"):
        read_scene(tmp_path / "scene.yaml", particles=3)


# -- YAML 1.2, core schema -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("010", 10),
        ("0x1F", "0x1F"),
        ("no", "no"),
        ("~", None),
        ("", None),
        ('"a\\nb"', "a\nb"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(tmp_path, text, value):
    path = tmp_path / "file.yaml"
    path.write_text(f"a: {text}\n")
    found = read_yaml(path)["a"]
    assert found == value
    assert type(found) is type(value)


OTHERWISE = ["1.", "007", "0x10", "0o17", "0b1", "1_000", "12", "-3", "0"]
OTHERWISE += [
    "yes",
    "No",
    "on",
    "OFF",
    "y",
    "true",
    "FALSE",
    "null",
    "Null",
    "~",
    "",
    ".inf",
    "-.INF",
    ".nan",
    "nan",
]
OTHERWISE += [
    "12:30",
    "1:30:00",
    "2020-09-28",
    "=",
    "<<",
    "- a",
    "a: b",
    "#",
    "'",
    '"',
    "\\",
    "é",
    "😀",
]


def test_texts_that_could_be_read_as_something_else_survive_being_written(tmp_path):
    """Such as the names of scenes: they are in quotes where YAML 1.1 or 1.2 has another value."""
    mapping = {"scenes": OTHERWISE, "one": {text: text for text in OTHERWISE}}
    (tmp_path / "study.yaml").write_text(yaml_text(mapping), encoding="utf-8")
    found = read_yaml(tmp_path / "study.yaml")
    assert found["scenes"] == OTHERWISE
    assert [*found["one"].items()] == [*mapping["one"].items()]
    assert yaml.safe_load((tmp_path / "study.yaml").read_text(encoding="utf-8")) == mapping, (
        "as YAML 1.1"
    )


def test_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: [2,\r\n  3]\r\n")
    assert read_yaml(path) == {"a": 1, "b": [2, 3]}
