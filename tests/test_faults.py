"""Bad input: one line that names the file, the key, the value and what is allowed."""

import re
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from brownpipe.errors import RequestError
from brownpipe.scene import read_scene
from brownpipe.scene.yaml_file import read_yaml
from brownpipe.study import read_study

SCENES = Path(__file__).parent / "scenes"
REFUSED = {name: one["refused"] for name, one in read_yaml(SCENES / "expected.yaml", 2**20).items() if "refused" in one}

EXPLICIT = """\
box: {x: [-3, 3], y: [-3, 3]}
disks:
  - {position: [0, 0], velocity: [1, 0], radius: 0.1, mass: 1}
duration: 1
"""
SPECIES = """\
box: {x: [-3, 3], y: [-3, 3]}
particles: 150
disks:
  tracer: {radius: 0.3, mass: 1, position: [0, 0]}
  species:
    - {name: bath, count: rest, radius: 0.1, mass: 0.4}
velocities: {temperature: 1.6}
duration: 1
"""


def refusal(path, read=read_scene):
    with pytest.raises(RequestError) as caught:
        read(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    assert len(line) < len(str(path)) + 300
    return line.removeprefix(f"{path}: ")


def value_refused(path):
    """The refusal of a value or key without its line, which every one of them has."""
    line, message = re.fullmatch("line ([0-9]+): (.*)", refusal(path)).groups()
    assert 1 <= int(line) <= path.read_text().count("\n") + 1
    return message


def changed(tmp_path, text, old, new):
    assert text.count(old) == 1
    path = tmp_path / "scene.yaml"
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize("name", REFUSED)
def test_scene_is_refused(name):
    assert REFUSED[name] in refusal(SCENES / f"{name}.yaml")


# -- files ---


@pytest.mark.promise(
    "a file that is no YAML, or YAML that two programs may read differently",
    "It is refused in one line that names the file and the line, before anything is computed.",
)
@pytest.mark.parametrize("read", [read_scene, read_study])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty; must be a mapping of keys to values"),
        (b"# nothing\n", "empty; must be a mapping"),
        (b"--- \n", "must be a mapping with the keys"),
        (b"\xff\xfe\x00", "not text: byte 0 is not UTF-8"),
        (b"\x89HDF\r\n\x1a\n", "not text: byte 0 is not UTF-8"),
        (b"a: \x00", "not valid YAML: "),
        (b"a: [1, 2\n", "line 2: not valid YAML: "),
        (b"a: 1\n\tb: 2\n", "line 2: not valid YAML: "),
        (b"just words\n", "must be a mapping with the keys"),
        (b"[1, 2]\n", "must be a mapping with the keys"),
        (b"a: 1\n---\nb: 2\n", "more than one YAML document; must be one"),
        (b"a: 1\nb: 2\na: 3\n", "line 3: duplicate key 'a'; must be given once"),
        (b"a: {b: 1, b: 1}\n", "line 1: duplicate key 'b'"),
        (b"a: &here 1\n", "line 1: anchors (&name) and aliases (*name) are not allowed"),
        (b"a: 1\nb: *here\n", "line 2: anchors (&name) and aliases (*name) are not allowed"),
        (b"a: !!python/object/apply:os.system ['true']\n", "line 1: the tag tag:yaml.org,2002:python/object/apply"),
        (b"a: !!float 1\n", "line 1: the tag tag:yaml.org,2002:float is not allowed; write a plain value"),
        (b"&a a: 1\n", "line 1: a key must be a plain word"),
        (b"? [a, b]\n: 1\n", "line 1: a key must be a plain word"),
        (b"<<: {a: 1}\n", "line 1: unknown key '<<'"),
        (b"a: 010\n", "line 1: 010: a number must not start with a superfluous zero"),
        (b"a: -007.5\n", "line 1: -007.5: a number must not start with a superfluous zero"),
        (b"a: 1e999\n", "line 1: 1e999: must be a finite number, below 1.8e308"),
        (b"a: " + 5000 * b"1", "line 1: a number of 5000 characters; must be at most 64"),
        (b"a: " + 100_000 * b"[", "line 1: nested more than 10 levels deep"),
        (b"a: " + 100_000 * b"{a: ", "line 1: nested more than 10 levels deep"),
    ],
)
def test_file_is_refused(tmp_path, read, content, message):
    path = tmp_path / "file.yaml"
    path.write_bytes(content)
    assert refusal(path, read).startswith(message)


@pytest.mark.parametrize("read", [read_scene, read_study])
def test_file_that_cannot_be_read(tmp_path, read):
    assert refusal(tmp_path / "absent.yaml", read) == "cannot be read: No such file or directory"
    assert refusal(tmp_path, read) == "cannot be read: Is a directory"
    with pytest.raises(RequestError, match="cannot be read: embedded null byte"):
        read("a\0b.yaml")


def test_file_that_is_too_large(tmp_path):
    path = tmp_path / "large.yaml"
    path.write_bytes((2**20 + 1) * b"#")
    assert refusal(path, read_study) == "larger than 1 MiB, the most that is read"
    assert refusal(path, read_scene).startswith("empty")


def test_file_name_that_cannot_be_a_folder(tmp_path):
    path = tmp_path / "my scene.yaml"
    path.write_text(EXPLICIT)
    assert "name of the file: must be a name: letters, digits" in refusal(path)
    assert refusal(path).endswith("not 'my scene'")


@pytest.mark.slow
@given(st.one_of(st.binary(max_size=40), st.text(alphabet="a:-[]{},&*!|>'\"%@? \n\t#0.1e", max_size=40)))
@example("a: " + "[" * 11)
@settings(max_examples=400, deadline=None)
def test_any_bytes_are_read_or_refused_in_one_line(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "any.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refusal(path)


# -- values ---


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radius: 0.1", "radius: -0.1", "disks[0].radius: must be a finite number > 0, not -0.1"),
        ("radius: 0.1", "radius: .inf", "disks[0].radius: must be a finite number > 0, not inf"),
        ("radius: 0.1", "radius: '0.1'", "disks[0].radius: must be a finite number > 0, not '0.1'"),
        ("radius: 0.1", "radius: true", "disks[0].radius: must be a finite number > 0, not true"),
        ("radius: 0.1", "radius: ", "disks[0].radius: must be a finite number > 0, not null"),
        ("radius: 0.1", "radius: [0.1]", "disks[0].radius: must be a finite number > 0, not [0.1]"),
        ("radius: 0.1", "radius: 1e-999", "disks[0].radius: must be a finite number > 0, not 0.0"),
        (
            "radius: 0.1",
            "radius: 3.1",
            "disks[0].radius: must be at most half the shorter side of the box, 3.0, not 3.1",
        ),
        (
            "radius: 0.1",
            "radios: 0.1",
            "disks[0]: unknown key 'radios'; did you mean radius? allowed: position, velocity,",
        ),
        ("radius: 0.1, ", "", "disks[0].radius: missing; must be given"),
        ("mass: 1", "mass: 0", "disks[0].mass: must be a finite number > 0, not 0"),
        ("position: [0, 0]", "position: [0]", "disks[0].position: must be two numbers [x, y], not [0]"),
        ("position: [0, 0]", "position: [0, 0, 0]", "disks[0].position: must be two numbers [x, y], not [0, 0, 0]"),
        ("position: [0, 0]", "position: 0", "disks[0].position: must be two numbers [x, y], not 0"),
        ("position: [0, 0]", "position: [0, no]", "disks[0].position[1]: must be a finite number, not 'no'"),
        (
            "position: [0, 0]",
            "position: [0, -2.95]",
            "disks[0].position: must be inside the walls, -3.0 <= y <= 3.0, by the",
        ),
        ("velocity: [1, 0]", "velocity: [.nan, 0]", "disks[0].velocity[0]: must be a finite number, not nan"),
        ("  - {", "  - 3\n  - {", "disks[0]: must be a mapping with the keys position, velocity, radius, mass, not 3"),
        ("duration: 1", "duration: 0", "duration: must be a finite number > 0, not 0"),
        ("duration: 1", "", "duration: missing; must be given"),
        ("duration: 1", "duration: 1\nparticles: 1", "particles: must not be given with an explicit list of disks"),
        (
            "duration: 1",
            "duration: 1\nvelocities: {temperature: 1}",
            "velocities: must not be given with an explicit list",
        ),
        ("duration: 1", "duration: 1\nequilibrate: 1", "equilibrate: must not be given with an explicit list"),
        ("duration: 1", "duration: 1\nsample_interval: 2", "sample_interval: must be at most the duration, 1.0, not 2"),
        ("duration: 1", "duration: 1\nsample_interval: 0", "sample_interval: must be a finite number > 0, not 0"),
        (
            "duration: 1",
            "duration: 1\nsample_interval: 1e-8",
            "sample_interval: must be at least 1e-07, for at most 10000000",
        ),
        ("x: [-3, 3]", "x: [3, -3]", "box.x: must be two numbers [low, high] with low < high, not [3, -3]"),
        ("x: [-3, 3]", "x: [3, 3]", "box.x: must be two numbers [low, high] with low < high, not [3, 3]"),
        ("x: [-3, 3]", "x: [-1e308, 1e308]", "box.x: must be two numbers [low, high] with low < high, not ["),
        ("x: [-3, 3]", "x: 6", "box.x: must be two numbers [low, high], not 6"),
        ("x: [-3, 3], ", "", "box.x: missing; must be given"),
        (
            "y: [-3, 3]}",
            "y: [-3, 3], boundary: hard}",
            "box.boundary: 'hard' is unknown; must be reflecting or periodic",
        ),
        ("y: [-3, 3]}", "y: [-3, 3], boundary: periodc}", "box.boundary: 'periodc' is unknown; did you mean periodic?"),
        (
            "y: [-3, 3]}",
            "y: [-3, 0], boundary: periodic}",
            "disks[0].position: must be inside the periodic box, -3.0 <= y < 0.0",
        ),
        (
            "y: [-3, 3]}",
            "y: [0, 0.3], boundary: periodic}",
            "box: a periodic box of 6.0 by 0.3 is too narrow; must be at least 0.4",
        ),
    ],
)
def test_explicit_scene_is_refused(tmp_path, old, new, message):
    assert value_refused(changed(tmp_path, EXPLICIT, old, new)).startswith(message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("radius: 0.1", "radius: 0", "disks.species[0].radius: must be a finite number > 0, not 0"),
        ("mass: 0.4", "mass: -1", "disks.species[0].mass: must be a finite number > 0, not -1"),
        (
            "mass: 0.4",
            "mas: 1",
            "disks.species[0]: unknown key 'mas'; did you mean mass? allowed: name, count, radius, mass",
        ),
        (
            "name: bath",
            "name: tracer",
            "disks.species[0].name: must be a name of its own (tracer is reserved), not 'tracer'",
        ),
        ("name: bath", "name: ../bath", "disks.species[0].name: must be a name: letters, digits, '.', '_', '-'"),
        ("name: bath", "name: 3", "disks.species[0].name: must be a name: "),
        ("count: rest", "count: -1", "disks.species[0].count: must be an integer from 0 to 10000000 or rest, not -1"),
        ("count: rest", "count: 1.0", "disks.species[0].count: must be an integer from 0 to 10000000 or rest, not 1.0"),
        (
            "count: rest",
            "count: rset",
            "disks.species[0].count: must be an integer from 0 to 10000000 or rest, not 'rset'",
        ),
        (
            "count: rest",
            "count: 5",
            "particles: must be 6, which is what the tracer and the species with numbers add up to",
        ),
        ("particles: 150\n", "", "particles: missing; must be given with `count: rest`"),
        (
            "particles: 150",
            "particles: 0",
            "particles: must be at least 1, which is what the tracer and the species with",
        ),
        ("particles: 150", "particles: 1e2", "particles: must be an integer from 0 to 10000000, not 100.0"),
        (
            "particles: 150",
            "particles: 2000",
            "disks: 1999 disks of radius 0.1 (bath) cannot fit; must be at most 1030",
        ),
        (
            "radius: 0.3",
            "radius: 3.5",
            "disks.tracer.radius: must be at most half the shorter side of the box, 3.0, not 3.5",
        ),
        (
            "position: [0, 0]",
            "position: [2.8, 0]",
            "disks.tracer.position: must be inside the walls, -3.0 <= x <= 3.0, by",
        ),
        (
            "  species:",
            "  placement: random\n  specis:",
            "disks: unknown key 'specis'; did you mean species? allowed: tracer,",
        ),
        (
            "  species:",
            "  placement: grid\n  species:",
            "disks.placement: 'grid' is unknown; must be random or lattice",
        ),
        ("temperature: 1.6", "temperature: -1", "velocities.temperature: must be a finite number >= 0, not -1"),
        (
            "temperature: 1.6",
            "temperature: 1, standard_deviation: 2",
            "velocities: must have either standard_deviation or",
        ),
        ("temperature: 1.6", "", "velocities: must have either standard_deviation or temperature"),
        (
            "temperature: 1.6",
            "temperature: 1, zero_momentum: yes",
            "velocities.zero_momentum: must be true or false, not 'yes'",
        ),
        ("velocities: {temperature: 1.6}\n", "", "velocities: missing; must be given with species"),
        ("duration: 1", "duration: 1\nequilibrate: -1", "equilibrate: must be a finite number >= 0, not -1"),
        ("duration: 1", "duration: 1\nequilibrate: {tracer: free}", "equilibrate.time: missing; must be given"),
        (
            "duration: 1",
            "duration: 1\nequilibrate: {time: 1, tracer: fixed}",
            "equilibrate.tracer: 'fixed' is unknown; must be",
        ),
        (
            "duration: 1",
            "duration: 1\nseeds: 3",
            "unknown key 'seeds'; allowed: box, disks, duration, particles, velocities,",
        ),
    ],
)
def test_scene_of_species_is_refused(tmp_path, old, new, message):
    assert value_refused(changed(tmp_path, SPECIES, old, new)).startswith(message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("duration: 1", "duration: 10 s", "duration: must be a finite number > 0, not '10 s'; without a unit"),
        ("duration: 1", "duration: '1'", "duration: must be a finite number > 0, not '1'; without quotes"),
        ("duration: 1", "duration: 0,5", "duration: must be a finite number > 0, not '0,5'; with a decimal point"),
        (
            "duration: 1",
            "duration: \N{MINUS SIGN}1",
            "must be a finite number > 0, not '\N{MINUS SIGN}1'; with the sign - for minus",
        ),
        ("particles: 150", "particles: 1e2", "particles: must be an integer from 0 to 10000000, not 100.0; write 100"),
        ("particles: 150", "particles: 1_50", "must be an integer from 0 to 10000000, not '1_50'; write 150"),
        ("particles: 150", "particles: 50, 100", "not '50, 100'; a list has brackets: [50, 100]"),
        ("particles: 150", "particles: (50, 100)", "not '(50, 100)'; a list has brackets: [50, 100]"),
        ("particles: 150", "N: 150", "unknown key 'N'; did you mean particles? allowed: "),
        ("temperature: 1.6", "kT: 1.6", "velocities: unknown key 'kT'; did you mean temperature? allowed: "),
        ("radius: 0.3", "radius: 0,3", "disks.tracer: unknown key '3'; a number has a decimal point"),
        ("x: [-3, 3]", "x: (-3, 3), z: (-2, 3)", "line 1: duplicate key '3)'; a list has brackets: [low, high]"),
        ("duration: 1", "duration:1", "line 8: not valid YAML: must be KEY: VALUE, with a blank after the colon"),
        ("duration: 1", "duration = 1", "line 8: not valid YAML: must be KEY: VALUE, with a blank after the colon"),
        ("duration: 1", "\tduration: 1", "line 8: not valid YAML: a tab; must be blanks"),
        (
            "duration: 1",
            "  duration: 1",
            "line 8: not valid YAML: a key is expected here; is the line indented like the others?",
        ),
        ("duration: 1", "duration: 1\nsamples: 100", "not 100; equal steps of time are sample_interval"),
        ("{name: bath,", "{name: bath, name2: [1], ", "disks.species[0]: unknown key 'name2'; did you mean name?"),
    ],
)
def test_common_mistakes_are_named(tmp_path, old, new, message):
    assert message in refusal(changed(tmp_path, SPECIES + "sample_interval: 0.1\n" * ("samples" not in new), old, new))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("runs: 10", "unknown key 'runs'; did you mean seeds? allowed: "),
        (
            "figures: msd, health",
            "figures: 'msd, health' is unknown; a list has brackets: [msd, health]; must be msd or",
        ),
        ("figures: [MSD]", "figures[0]: 'MSD' is unknown; did you mean msd? must be msd or"),
        ("record: true", "record: must be tracer or none, not true"),
        ("engines: [timestep: {time_step: 1e-3}]", "engines[0].name: missing; must be given, as in {name: exact}"),
        (
            "engines: [{name: timestep, time_step: 1 ms}]",
            "time_step: must be a finite number > 0, not '1 ms'; without a",
        ),
        ("batch: 1e2", "batch: must be an integer from 1 to 10000000 or auto, not 100.0; write 100"),
    ],
)
def test_common_mistakes_in_a_study_are_named(tmp_path, text, message):
    (tmp_path / "scene.yaml").write_text(SPECIES)
    (tmp_path / "study.yaml").write_text(f"scenes: scene.yaml\nseeds: 3\n{text}\n")
    assert message in refusal(tmp_path / "study.yaml", read_study)


def test_a_name_without_its_suffix_is_completed(tmp_path):
    (tmp_path / "scene.yaml").write_text(SPECIES)
    assert refusal(tmp_path / "scene") == "cannot be read: No such file or directory; did you mean scene.yaml?"


def test_the_scenes_that_are_changed_above_are_right(tmp_path):
    assert read_scene(changed(tmp_path, EXPLICIT, "radius: 0.1", "radius: 0.2")).particles == 1
    assert read_scene(changed(tmp_path, SPECIES, "radius: 0.1", "radius: 0.05")).particles == 150


@pytest.mark.parametrize(
    ("disks", "message"),
    [
        ("{}", "disks: must be a list of disks, or a mapping with tracer, species or both, not a mapping"),
        ("3", "disks: must be a list of disks, or a mapping with tracer, species or both, not 3"),
        ("{species: 3}", "disks.species: must be a list, not 3"),
        (
            "{species: [{name: a, count: rest, radius: 1, mass: 1}, {name: b, count: rest, radius: 1, mass: 1}]}",
            "disks.species[1].count: must be a number, as only one species can be the rest, not 'rest'",
        ),
        (
            "{species: [{name: a, count: 1, radius: 1, mass: 1}, {name: a, count: 1, radius: 1, mass: 1}]}",
            "disks.species[1].name: must be a name of its own (tracer is reserved), not 'a'",
        ),
    ],
)
def test_disks_are_refused(tmp_path, disks, message):
    path = tmp_path / "scene.yaml"
    path.write_text(f"box: {{x: [0, 9], y: [0, 9]}}\nduration: 1\nvelocities: {{temperature: 1}}\ndisks: {disks}\n")
    assert value_refused(path).startswith(message)


def test_pinned_tracer_needs_a_tracer(tmp_path):
    path = tmp_path / "scene.yaml"
    disks = "disks: {species: [{name: a, count: 1, radius: 1, mass: 1}]}\nequilibrate: {time: 1, tracer: pinned}"
    path.write_text(f"box: {{x: [0, 9], y: [0, 9]}}\nduration: 1\nvelocities: {{temperature: 1}}\n{disks}\n")
    assert value_refused(path) == "equilibrate.tracer: must be free, as there is no tracer, not 'pinned'"
