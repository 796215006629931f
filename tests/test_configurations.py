"""Disks of a file: what our exports hold is read back, and so is what other programs write."""

import json

import gsd.hoomd as hoomd
import numpy as np
import pandas
import pytest

import brownpipe as bp
from brownpipe.cli import main
from brownpipe.engines.forecast import pair_rate
from brownpipe.engines.friction import friction_rate
from brownpipe.errors import RequestError
from brownpipe.scene import parse_scene
from brownpipe.scene.configuration import Configuration
from brownpipe.scene.sections import Box
from brownpipe.scene.species import kinds_of
from brownpipe.storage.configurations import read_configuration, read_scene

BOX = {"x": [-2.0, 8.0], "y": [1.0, 9.0], "boundary": "periodic"}
EQUILIBRATED = """\
box: {x: [-2.0, 8.0], y: [1.0, 9.0], boundary: periodic}
disks:
  tracer: {radius: 0.6, mass: 3.0}
  species:
    - {name: small, count: 20, radius: 0.2, mass: 0.5}
    - {name: large, count: 10, radius: 0.4, mass: 2.0}
velocities: {temperature: 1.5}
duration: 2.0
sample_interval: 0.5
"""
BRANCH = """\
box: {x: [-2.0, 8.0], y: [1.0, 9.0], boundary: periodic}
disks: {file: FILE}
velocities: {temperature: 1.5}
duration: 1.0
sample_interval: 0.5
"""
TABLE = "x,y,radius,mass\n0,2,0.5,1\n2,2,0.5,1\n4,2,0.25,2\n"
PROPERTIES = "Properties=type:S:1:pos:R:3:radius:R:1:mass:R:1"
HEAD = f'{PROPERTIES} Lattice="10 0 0 0 8 0 0 0 1"'


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The folder of two runs, and of the end of the second in three formats."""
    folder = tmp_path_factory.mktemp("exported")
    (folder / "fluid.yaml").write_text(EQUILIBRATED)
    runs = str(folder / "runs.h5")
    scene = str(folder / "fluid.yaml")
    assert main(["simulate", scene, "--seeds", "3-4", "--record", "all", "--output", runs]) == 0
    for form in ("csv", "xyz", "gsd"):
        output = str(folder / f"disks.{form}")
        assert main(["export", runs, "--to", form, "--seed", "4", "--output", output]) == 0
    return folder


def end_of(folder, seed=4, time=2.0):
    """Position and velocity of all disks as the file of runs has them."""
    disks = bp.open(folder / "runs.h5").disks.sel(seed=seed, time=time)
    return disks.position.values, disks.velocity.values


@pytest.mark.parametrize("form", ["h5", "csv", "xyz", "gsd"])
def test_what_is_exported_is_read_back(exported, form):
    path = exported / ("runs.h5" if form == "h5" else f"disks.{form}")
    seed = 4 if form in ("h5", "csv") else None
    disks = read_configuration(path, Box(**BOX), seed)
    position, velocity = end_of(exported)
    expected = read_scene(exported / "fluid.yaml")
    if form == "gsd":  # single precision
        assert np.abs(disks.position - position).max() < 1e-6
        np.testing.assert_allclose(disks.velocity, velocity, rtol=1e-6)
        np.testing.assert_allclose(disks.radius, expected.radius, rtol=1e-7)
    else:
        assert np.array_equal(disks.position, position)
        assert np.array_equal(disks.velocity, velocity)
        assert np.array_equal(disks.radius, expected.radius)
    assert np.array_equal(disks.mass, expected.mass)
    assert disks.names == ("tracer", "small", "large")
    assert disks.species_index.tolist() == [0] + 20 * [1] + 10 * [2]


@pytest.fixture(scope="module", params=["x", "y"])
def channel(request, tmp_path_factory):
    """The folder of a run in a channel along x or y and of its end in three formats, and the line
    of its scene file with its box.
    """
    walls = {"x": "y", "y": "x"}[request.param]
    boundary = f"{{{request.param}: periodic, {walls}: reflecting}}"
    folder = tmp_path_factory.mktemp(f"channel_{request.param}")
    text = EQUILIBRATED.replace("boundary: periodic", f"boundary: {boundary}")
    (folder / "channel.yaml").write_text(text)
    runs = str(folder / "runs.h5")
    scene = str(folder / "channel.yaml")
    assert main(["simulate", scene, "--seeds", "4", "--record", "all", "--output", runs]) == 0
    for form in ("csv", "xyz", "gsd"):
        output = str(folder / f"disks.{form}")
        assert main(["export", runs, "--to", form, "--output", output]) == 0
    return folder, text.splitlines()[0]


@pytest.mark.parametrize("form", ["h5", "csv", "xyz", "gsd"])
def test_runs_branch_from_the_end_of_a_run_in_a_channel(channel, form):
    folder, box = channel
    name = "runs.h5" if form == "h5" else f"disks.{form}"
    text = BRANCH.replace(BRANCH.splitlines()[0], box).replace("FILE", name)
    (folder / f"{form}.yaml").write_text(text)
    scene = read_scene(folder / f"{form}.yaml")
    assert scene.box == read_scene(folder / "channel.yaml").box
    position, _ = end_of(folder)
    assert np.abs(scene.configuration.position - position).max() < 1e-6
    track = bp.simulate(scene, 1, record=["all"], quiet=True)
    assert track.disks.image.any(("seed", "time", "disk")).values.tolist() == [
        *scene.box.periodic_axes
    ]


def test_the_scene_of_runs_in_a_channel_is_exported(channel, tmp_path):
    folder, _ = channel
    again = str(tmp_path / "again.yaml")
    assert main(["export", str(folder / "runs.h5"), "--to", "scene", "--output", again]) == 0
    expected = read_scene(folder / "channel.yaml")
    assert read_scene(again).digest == expected.digest
    assert read_scene(again).box == expected.box


@pytest.mark.parametrize("form", ["h5", "csv", "xyz", "gsd"])
def test_the_boundary_is_that_of_the_scene_whatever_the_file_says(channel, form):
    """Disks between walls may go on in a periodic box; those that reach over its sides may not go
    on between walls.
    """
    folder, _ = channel
    name = "runs.h5" if form == "h5" else f"disks.{form}"
    text = BRANCH.replace("FILE", name)
    (folder / "periodic.yaml").write_text(text)
    assert not read_scene(folder / "periodic.yaml").box.has_walls
    (folder / "walls.yaml").write_text(text.replace("periodic", "reflecting"))
    with pytest.raises(RequestError, match=r"must have the disk inside the box") as refused:
        read_scene(folder / "walls.yaml")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("form", ["h5", "csv", "xyz", "gsd"])
def test_a_sample_is_chosen_by_its_time(exported, form):
    path = exported / ("runs.h5" if form == "h5" else f"disks.{form}")
    seed = 4 if form in ("h5", "csv") else None
    disks = read_configuration(path, Box(**BOX), seed, time=0.5)
    position, _ = end_of(exported, time=0.5)
    assert np.abs(disks.position - position).max() < 1e-6
    with pytest.raises(RequestError, match=r"time: must be one of 0, 0\.5, 1, 1\.5, 2, not 0\.7"):
        read_configuration(path, Box(**BOX), seed, time=0.7)


def test_runs_branch_from_one_state(exported, tmp_path):
    """Positions are those of the file for each seed, velocities are drawn, masses replaced."""
    file = f"{exported / 'runs.h5'}, tracer: {{mass: 30.0}}"
    (tmp_path / "branch.yaml").write_text(BRANCH.replace("FILE", file))
    scene = bp.read_scene(tmp_path / "branch.yaml")
    assert scene.mass[0] == 30.0
    assert scene.has_tracer
    runs = bp.simulate(scene, 5, record=["all"], quiet=True)
    result = bp.analyse(runs)
    assert float(result.msd_standard_error.isel(time=-1).squeeze()) > 0
    position, _ = end_of(exported, seed=3)
    start = runs.disks.isel(time=0)
    assert start.sizes["seed"] == 5
    for seed in range(5):
        assert np.array_equal(start.position.sel(seed=seed), position)
    first, second = (start.velocity.sel(seed=seed).values for seed in (0, 1))
    assert not np.allclose(first, second)
    momentum = (scene.mass[:, None] * first).sum(axis=0)
    assert np.abs(momentum).max() < 1e-12


def test_velocities_of_the_file_are_used_if_the_scene_draws_none(exported, tmp_path):
    text = BRANCH.replace("velocities: {temperature: 1.5}\n", "")
    (tmp_path / "on.yaml").write_text(text.replace("FILE", str(exported / "disks.csv, seed: 4")))
    scene = bp.read_scene(tmp_path / "on.yaml")
    run = bp.simulate(scene, record=["all"], quiet=True)
    position, velocity = end_of(exported)
    start = run.disks.isel(seed=0, time=0)
    assert np.array_equal(start.position, position)
    assert np.array_equal(start.velocity, velocity)
    with pytest.raises(RequestError, match="seeds: must be one seed"):
        bp.simulate(scene, 2, quiet=True)


def test_runs_depend_on_the_contents_of_the_file_not_on_its_name(tmp_path):
    (tmp_path / "a.csv").write_text(TABLE)
    (tmp_path / "b.csv").write_text(TABLE.replace("0,2,", "0.0, 2e0,"))
    (tmp_path / "c.csv").write_text(TABLE.replace("0,2,", "0.1,2,"))
    digests = []
    for name in "abc":
        (tmp_path / "scene.yaml").write_text(BRANCH.replace("FILE", f"{name}.csv"))
        digests.append(read_scene(tmp_path / "scene.yaml").digest)
    assert digests[0] == digests[1] != digests[2]


def test_the_text_of_a_scene_has_its_disks(exported, tmp_path):
    """So that a file of runs can be read without the file that they began from."""
    (tmp_path / "branch.yaml").write_text(BRANCH.replace("FILE", str(exported / "disks.xyz")))
    scene = read_scene(tmp_path / "branch.yaml")
    again = parse_scene(json.loads(scene.text), "branch.yaml")
    assert again == scene
    assert np.array_equal(again.configuration.position, scene.configuration.position)
    again.save(tmp_path / "saved.yaml")
    saved = read_scene(tmp_path / "saved.yaml")
    assert saved.digest == scene.digest


def test_the_mass_of_the_tracer_is_varied(exported, tmp_path):
    (tmp_path / "branch.yaml").write_text(BRANCH.replace("FILE", str(exported / "runs.h5")))
    result = bp.scan(
        tmp_path / "branch.yaml", {"disks.tracer.mass": [1.0, 30.0]}, seeds=3, quiet=True
    )
    assert result.tracer_mass.values.tolist() == [1.0, 30.0]
    assert np.isfinite(result.msd).all()


def test_a_gsd_of_another_program(tmp_path):
    frame = hoomd.Frame()
    frame.particles.N = 2
    frame.particles.position = [[-1.0, 0.0, 0.0], [1.0, 0.5, 0.0]]
    frame.configuration.box = [10, 8, 0, 0, 0, 0]
    with hoomd.open(str(tmp_path / "other.gsd"), "w") as trajectory:
        trajectory.append(frame)
    disks = read_configuration(tmp_path / "other.gsd", Box(**BOX))
    assert disks.position.tolist() == [[2.0, 5.0], [4.0, 5.5]]
    assert disks.radius.tolist() == [0.5, 0.5]
    assert disks.mass.tolist() == [1.0, 1.0]
    assert disks.names == ("A",)
    assert disks.velocity is None  # none were written
    with pytest.raises(RequestError, match="box: must be that of the scene, 9 x 8, not 10 x 8"):
        read_configuration(tmp_path / "other.gsd", Box(x=[0.0, 9.0], y=[0.0, 8.0]))


def test_frames_may_be_apart_and_the_last_is_taken(tmp_path):
    frame = f"1\n{HEAD} Time=TIME\nA TIME 2 0 0.5 1\n"
    text = frame.replace("TIME", "1.5") + "\n" + frame.replace("TIME", "2.5")
    (tmp_path / "two.xyz").write_text(text, "utf-8-sig")
    assert read_configuration(tmp_path / "two.xyz").position.tolist() == [[2.5, 2.0]]
    first = read_configuration(tmp_path / "two.xyz", time=1.5)
    assert first.position.tolist() == [[1.5, 2.0]]


def test_nothing_is_left_of_a_scene_that_cannot_be_saved(exported, tmp_path):
    (tmp_path / "branch.yaml").write_text(BRANCH.replace("FILE", str(exported / "disks.xyz")))
    (tmp_path / "mine.yaml").write_text("something else\n")
    with pytest.raises(RequestError, match=r"mine\.yaml: exists"):
        read_scene(tmp_path / "branch.yaml").save(tmp_path / "mine.yaml")
    assert not (tmp_path / "mine_disks.csv").exists()


def test_momenta_and_species_of_ase(tmp_path):
    text = (
        '2\nLattice="10 0 0 0 8 0 0 0 1" Properties=species:S:1:pos:R:3:masses:R:1:momenta:R:3:'
        'radius:R:1 pbc="T T F"\n'
        "Ar 0.5 2.0 0 2.0 4.0 -1.0 0 0.3\nNe 3.5 2.0 0 1.0 0.5 1.0 0 0.2\n"
    )
    (tmp_path / "ase.extxyz").write_text(text)
    disks = read_configuration(tmp_path / "ase.extxyz")
    assert disks.velocity.tolist() == [[2.0, -0.5], [0.5, 1.0]]
    assert disks.names == ("Ar", "Ne")


ROW = "0,2,0.5,1\n"
WRONG_TABLES = {
    "": "is empty",
    "\n \n": "holds no disks",
    "x,y,radius,mass\n": "must have at least one disk",
    "x,y,radius,mass,time\n": "must have at least one disk",
    "x,y,radius\n0,2,0.5\n": "line 1: mass: missing; the columns are x, y, radius",
    "x,y,radius,mass\n0,2,0.5,1\n2,,0.5,1\n": "line 3: y: missing",
    "\nx,y,radius,mass\n0,2,0.5,1\n\n2,,0.5,1\n": "line 5: y: missing",
    "x,y,radius,mass\r\n0,2,0.5,1\r\n\r\n2,,0.5,1\r\n": "line 4: y: missing",
    "x,y,radius,mass\n0,2,0.5,1\n2,nan,0.5,1\n": "line 3: y: must be a number, not nan",
    "x,y,radius,mass\n0,2,0.5,1\n2,inf,0.5,1\n": "line 3: y: must be a number, not inf",
    "x,y,radius,mass\n0,two,0.5,1\n": "line 2: y: must be a number, not two",
    "x,y,radius,mass\n0,2,-0.5,1\n": "radius: must be above 0, not -0.5 (disk 0)",
    "x,y,radius,mass\n0,2,0.5,0\n": "mass: must be above 0, not 0 (disk 0)",
    "Some words\nand more.\n": "line 1: must be titles separated by commas, as in x,y,radius,mass",
    f"# of a program\nx,y,radius,mass\n{ROW}": "in x,y,radius,mass, not # of",
    "x;y;radius;mass\n0,5;2,0;0,5;1,0\n": "as in x,y,radius,mass, not x;y;radius;mass",
    "x\ty\tradius\tmass\n0\t2\t0.5\t1\n": "separated by commas",
    f"# x,y,radius,mass\n{ROW}": "line 1: x: missing; the columns are # x, y, radius, mass",
    f"x,y,radius,mass\n{ROW}0,4,0.5,1,\n": "line 3: must have 4 values, x, y, radius, mass; not 5",
    "x,y,radius,mass\n0,2,0.5,1,7,8\n": "line 2: must have 4 values, x, y, radius, mass; not 6",
    "x,y,radius,mass\n0,2,0.5\n": "line 2: must have 4 values, x, y, radius, mass; not 3",
    "x,y,radius,mass\n0,5,2,0,0,5,1,0\n": "line 2: must have 4 values",
    'x,y,radius,mass\n0,2,0.5,"1\n': "must be values separated by commas",
    "x,y,radius,mass\n1_0,2,0.5,1\n": "line 2: x: must be a number, not 1_0",
    "x,y,radius,mass,x\n0,2,0.5,1,7\n": "line 1: x: must be in one column, not in 2",
    "x,y,radius,mass,X\n0,2,0.5,1,7\n": "line 1: x: must be in one column, not in 2",
    "x,y,radius,mass,vx,vy,velocity_x\n0,2,0.5,1,7,7,8\n": "vx: must not be given with",
    "x,y,radius,mass,VX\n0,2,0.5,1,7\n": "line 1: vy: missing",
    "x,y,radius,mass,species\n0,2,0.5,1,a\n0,4,0.5,1,\n": "line 3: species: missing",
    "x,y,radius,mass,species\n0,2,0.5,1,a b\n": "line 2: species: must be a name: letters",
    "x,y,z,radius,mass\n0,2,0,0.5,1\n2,2,3,0.5,1\n": "z: must be the same for all disks",
    "x,y,vx,vy,vz,radius,mass\n0,2,1,1,-3,0.5,1\n": "along z: must be 0 for all disks",
    f"time,x,y,radius,mass\n1,{ROW}1,2,{ROW[2:]}1.1,{ROW}": "time: must have equally many",
}
WRONG_XYZ = {
    "": "is empty",
    "\n\n": "holds no disks",
    f"0\n{HEAD}\n": "must have at least one disk",
    f"2\n{HEAD}\nA 0 2 0 0.5 1\n": "ends after 1 of 2 disks",
    f"999999999\n{HEAD}\nA 0 2 0 0.5 1\n": "ends after 1 of 999999999 disks",
    f"{'1' * 5000}\n{HEAD}\nA 0 2 0 0.5 1\n": "line 1: must be the number of disks, not 1111",
    f"1\n{HEAD}\nA 0 2 x 0.5 1\n": "line 3: pos-2: must be a number",
    f"1\n{HEAD}\nA 0,0 2 0 0.5 1\n": "line 3: pos-0: must be a number, not 0,0",
    f"1\n{HEAD}\nA 0 2 0 0.5\n": "line 3: must have 6 values, type, pos-0, pos-1, pos-2, radius",
    f"2\n{HEAD}\nA 0 2 0 0.5 1\nA 3 2 1 0.5 1\n": "z: must be the same for all disks",
    f"1\n{PROPERTIES}:velo:R:3\nA 0 2 0 0.5 1 0 0 -2\n": "velocity along z: must be 0",
    "1\nno properties\nA 0 2 0\n": "line 2: Properties: must have radius",
    f"1\n{PROPERTIES}:radius:R:1\nA 0 2 0 0.5 1 2\n": "radius: must be in one column, not in 2",
    f"1\n{PROPERTIES}:spin:R:\u00b2\n\n": "Properties: must be name:type:width, not type:S",
    f"1\n{PROPERTIES}:spin:R:999999999\n\n": "Properties: must be name:type:width, not type:S",
    "Dear all\n": "line 1: must be the number of disks, not Dear all",
    "\u00b2\n": "line 1: must be the number of disks",
}
WRONG_LATTICES = {
    'Lattice="10 1 0 0 8 0 0 0 1"': "line 2: Lattice: must be a rectangle along x and y",
    'Lattice="12 0 0 0 8 0 0 0 1"': "box: must be that of the scene, 10 x 8, not 12 x 8",
    'lattice="12 0 0 0 8 0 0 0 1"': "box: must be that of the scene",
    "Lattice='12 0 0 0 8 0 0 0 1'": "box: must be that of the scene",
    'Lattice = "12 0 0 0 8 0 0 0 1"': "box: must be that of the scene",
    r'note="a \" Time=1" LATTICE="12 0 0 0 8 0 0 0 1"': "box: must be that of the scene",
    'Lattice="10 0 0 0 8 0"': "line 2: Lattice: must be nine numbers",
    "Lattice=[[10, 0, 0], [0, 8, 0], [0, 0, 1]]": "line 2: Lattice: must be nine numbers",
    'Lattice="10 0 0 0 8 0 0 0 1" origin="0 0 0"': "box: must be that of the scene, from (-2",
    'Lattice="10 0 0 0 8 0 0 0 1" Origin="-2"': "line 2: Origin: must be three numbers",
}
for lattice, refusal in WRONG_LATTICES.items():
    WRONG_XYZ[f"1\n{lattice} {PROPERTIES}\nA 0 2 0 0.5 1\n"] = refusal
WRONG_FILES = [("csv", *item) for item in WRONG_TABLES.items()]
WRONG_FILES += [("xyz", *item) for item in WRONG_XYZ.items()]
PROBLEMS = [problem for *_, problem in WRONG_FILES]


@pytest.mark.parametrize(("form", "text", "problem"), WRONG_FILES, ids=PROBLEMS)
def test_wrong_files_are_refused_in_one_line(form, text, problem, tmp_path):
    path = tmp_path / f"wrong.{form}"
    path.write_bytes(text.encode())
    with pytest.raises(RequestError) as refused:
        read_configuration(path, Box(**BOX))
    message = str(refused.value)
    assert message.startswith(f"{path}: ")
    assert problem in message
    assert "\n" not in message
    assert len(message.removeprefix(str(path))) < 200


SAME_TABLES = [
    ("csv", "\ufeffX, Y, Radius, Mass, Species\r\n0, 2, 0.5, 1, A\r\n2, 2, 0.25, 2, B\r\n"),
    ("csv", "species,mass,radius,y,x\nA,1,.5,2,0\n\n,,,,\nB,2e0,0.25,2,2\n"),
    ("csv", ',x,y,radius,mass,species\n0,0,2,0.5,1,"A"\n1,2,2,0.25,2,B\n'),  # pandas has an index
    ("csv", "z,x,y,vz,radius,mass,species\n3,0,2,0,0.5,1,A\n3,2,2,0,0.25,2,B\n"),
    ("xyz", f"2\r\n{HEAD}\r\nA 0 2 0 0.5 1\r\nB\t2\t2\t0\t0.25\t2\r\n"),
    ("xyz", f"2\n{HEAD.replace('Prop', 'prop')}\nA 0 2 0 .5 1\nB 2 2 0 .25 2"),
    ("xyz", f"2\n{HEAD.replace('radius', 'Radius')}\nA 0 2 0 0.5 1\nB 2 2 0 0.25 2\n"),
    ("xyz", "2\n" + HEAD.replace('"', "'") + "\nA 0 2 0 0.5 1\nB 2 2 0 0.25 2\n"),
]  # fmt: skip


@pytest.mark.parametrize(("form", "text"), SAME_TABLES)
def test_tables_of_other_programs(form, text, tmp_path):
    (tmp_path / f"other.{form}").write_bytes(text.encode())
    disks = read_configuration(tmp_path / f"other.{form}", Box(**BOX))
    assert disks.position.tolist() == [[0.0, 2.0], [2.0, 2.0]]
    assert disks.radius.tolist() == [0.5, 0.25]
    assert disks.mass.tolist() == [1.0, 2.0]
    assert disks.names == ("A", "B")
    assert disks.velocity is None


def test_a_seed_is_taken_exactly(tmp_path):
    """Seeds may be large, and differ by less than times that are the same up to round-off."""
    large = 99999999998
    rows = f"{large},1,2,0.5,1\n{large + 1},3,2,0.5,1\n"
    (tmp_path / "seeds.csv").write_text(f"seed,x,y,radius,mass\n{rows}")
    disks = read_configuration(tmp_path / "seeds.csv", seed=large + 1)
    assert disks.position.tolist() == [[3.0, 2.0]]
    with pytest.raises(
        RequestError, match="must be one of 99999999998, 99999999999, not 99999999997"
    ):
        read_configuration(tmp_path / "seeds.csv", seed=large - 1)


PAIR = {"position": [[0.0, 2.0], [2.0, 2.0]], "radius": [0.5, 0.2], "mass": [1.0, 2.0]}
RECORDS = np.array([(1.0,), (2.0,)], dtype=[("mass", float)])
DATES = np.array(["2020-01-01", "2020-01-02"], "datetime64[D]")
MASKED = np.ma.array([0.5, 0.2], mask=[False, True])
MASKED_ROWS = [np.ma.array([0.0, 2.0], mask=[False, True]), np.array([2.0, 2.0])]


@pytest.mark.parametrize(("field", "value", "problem"), [
    ("position", np.array(PAIR["position"]) + 0j, "be an array of numbers, not of complex128"),
    ("radius", MASKED, "have no masked values (disk 1)"),
    ("radius", [0.5, np.ma.masked], "have no masked values (disk 1)"),
    ("position", MASKED_ROWS, "have no masked values (disk 0)"),
    ("mass", [True, True], "be an array of numbers, not of bool"),
    ("mass", ["1", "2"], "be an array of numbers, not of str"),
    ("mass", np.array(["1", 2.0], object), "be an array of numbers, not of object"),
    ("mass", [1.0, None], "be an array of numbers, not of object"),
    ("mass", RECORDS, "be an array of numbers, not of void"),
    ("mass", DATES, "be an array of numbers, not of datetime64"),
    ("mass", [1.0, 10**400], "be an array of numbers"),
    ("mass", [1.0, np.nan], "be finite, not nan (disk 1)"),
    ("position", [[0.0, 2.0], [2.0]], "be an array of numbers"),
    ("position", [[0.0, 2.0, 4.0], [2.0, 2.0, 2.0]], "be an array of shape (2, 2), not (2, 3)"),
    ("species_index", [0, 1], "be given with names"),
])  # fmt: skip
def test_wrong_arrays(field, value, problem):
    with pytest.raises(RequestError) as refused:
        scene_of_arrays(**{field: value})
    assert f"disks.configuration.{field}: must {problem}" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("index", [
    [0, 1.5], [0, np.nan], [0, np.inf], [False, True], ["0", "1"], [0, 2**63], [0, 2**70],
])  # fmt: skip
def test_an_index_of_species_is_an_integer(index):
    with pytest.raises(RequestError, match="species_index: must be an array of integers"):
        scene_of_arrays(names=("a", "b"), species_index=index)


def test_arrays_of_other_packages_are_numbers():
    scene = scene_of_arrays(
        radius=np.ma.array([0.5, 0.2]),
        mass=pandas.array([1.0, 2.0], dtype="Float64"),
        names=["a", "b"],
        species_index=np.array([0.0, 1.0]),
    )
    assert scene.radius.tolist() == [0.5, 0.2]
    assert scene.mass.tolist() == [1.0, 2.0]
    assert scene.configuration.species_index.tolist() == [0, 1]


def scene_of_arrays(**arrays):
    """The scene of two disks, of which some arrays are others."""
    disks = Configuration(**{"velocity": None, **PAIR, **arrays})
    given = {"configuration": disks}
    return bp.Scene(box=BOX, disks=given, velocities={"temperature": 1.0}, duration=1.0)


def test_a_configuration_is_named_among_the_disks():
    disks = Configuration(**{"velocity": None, **PAIR})
    with pytest.raises(RequestError, match=r'disks: must be {"configuration": disks}, not the'):
        bp.Scene(box=BOX, disks=disks, velocities={"temperature": 1.0}, duration=1.0)


def test_a_disk_that_is_given_twice_is_not_to_be_pushed_apart():
    twice = [[1.0, 2.0], [1.0, 2.0]]
    with pytest.raises(RequestError, match=r"must be >= 0; is a disk given twice\?$"):
        scene_of_arrays(position=twice)
    near = [[1.0, 2.0], [1.35, 2.0]]  # half a contact distance apart
    with pytest.raises(RequestError, match=r"; push_apart: \S+ would push all apart$"):
        scene_of_arrays(position=near)


def test_wrong_files(exported, tmp_path):
    for name in ("absent.csv", "absent.xyz", "absent.gsd", "absent.h5"):
        with pytest.raises(RequestError, match=f"{name}: cannot be read: No such file"):
            read_configuration(tmp_path / name)
    with pytest.raises(RequestError, match=r"must end in \.csv, "):
        read_configuration(tmp_path / "disks.txt")
    for suffix in (".csv", ".xyz", ".gsd", ".h5"):
        (tmp_path / f"bytes{suffix}").write_bytes(bytes(range(256)) * 9)
        with pytest.raises(bp.BrownpipeError) as refused:
            read_configuration(tmp_path / f"bytes{suffix}")
        assert "\n" not in str(refused.value)
    with pytest.raises(RequestError, match="holds no run of seed 9"):
        read_configuration(exported / "runs.h5", seed=9)
    with pytest.raises(RequestError, match="seed: must not be given"):
        read_configuration(exported / "disks.xyz", seed=1)


@pytest.mark.parametrize(("disks", "problem"), [
    ("{file: none.csv}", "none.csv: cannot be read: No such file"),
    ("{file: 3}", "line 2: disks.file: "),
    ("{file: a.csv, sed: 3}", "line 2: disks.sed: unknown key; did you mean seed?"),
    ("{file: a.csv, tracer: {count: 3}}", "line 2: disks.tracer.count: unknown key"),
    ("{file: a.csv, species: {bath: {mass: 3.0}}}", "must be a species of the disks: kind-1"),
    ("{file: a.csv, tracer: {radius: 9.0}}", "disks[0].radius: must be"),
    ("{file: a.csv, tracer: {position: [1.5, 2.0]}}", "overlap: the gap between their edges"),
    ("{file: a.csv, tracer: {position: [11.5, 2.0]}}", "must have the disk inside the box"),
])  # fmt: skip
def test_wrong_scenes(disks, problem, tmp_path):
    (tmp_path / "a.csv").write_text(TABLE)
    (tmp_path / "scene.yaml").write_text(BRANCH.replace("{file: FILE}", disks))
    with pytest.raises(RequestError) as refused:
        read_scene(tmp_path / "scene.yaml")
    assert problem in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_polydisperse_sample_is_one_species():
    random = np.random.default_rng(1)
    x, y = np.meshgrid(np.arange(10) * 1.0 + 0.5, np.arange(10) * 1.0 + 0.5)
    disks = Configuration(
        position=np.stack([x.ravel(), y.ravel()], axis=1),
        velocity=None,
        radius=random.uniform(0.3, 0.45, 100),
        mass=random.uniform(1.0, 2.0, 100),
    )
    box = {"x": [0, 10], "y": [0, 10], "boundary": "periodic"}
    scene = bp.Scene(
        box=box,
        disks={"configuration": disks},
        velocities={"temperature": 1.0},
        equilibrate={"time": 1.0, "tracer": "free"},
        duration=1.0,
        sample_interval=0.25,
    )
    runs = bp.simulate(scene, 8, observables=["pair_distribution", "species_energy"], quiet=True)
    result = bp.analyse(runs).squeeze()
    assert result.species.values.tolist() == "disks"
    assert result.species_pair.values.tolist() == "disks:disks"
    assert np.isnan(result.contact_value)  # disks touch at many distances
    assert np.isfinite(result.pair_distribution).any()
    energy = result.species_energy.isel(time=-1)
    error = result.species_energy_standard_error.isel(time=-1)
    assert abs(energy - 1.0) < 5 * error
    # Enskog's theory over classes of radii; 100 disks are some 2 % from it
    expected = float(result.enskog_compressibility)
    assert float(result.compressibility) == pytest.approx(expected, rel=0.05)


def test_the_scene_of_runs_is_exported_with_its_disks(exported, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "branch.yaml").write_text(BRANCH.replace("FILE", str(exported / "disks.xyz")))
    assert main(["simulate", "branch.yaml", "--seeds", "0", "--output", "b.h5"]) == 0
    assert main(["export", "b.h5", "--to", "scene", "--output", "again.yaml"]) == 0
    assert read_scene("again.yaml").digest == read_scene("branch.yaml").digest
    assert (tmp_path / "again_disks.csv").exists()
    assert main(["export", "b.h5", "--to", "scene", "--output", "again.yaml"]) == 2  # it is there
    assert main(["inspect", "b.h5", "--scene"]) == 2
    assert main(["inspect", "b.h5"]) == 0


def alternating(masses, radii, tracer):
    """400 disks on a square lattice with the masses in turn, of these radii; the tracer's mass."""
    x, y = np.meshgrid(np.arange(20) + 0.5, np.arange(20) + 0.5)
    mass = np.resize(np.array(masses, float), 400)
    mass[0] = tracer
    disks = Configuration(np.stack([x.ravel(), y.ravel()], axis=1), None, radii, mass)
    return bp.Scene(
        box={"x": [0, 20], "y": [0, 20], "boundary": "periodic"},
        disks={"configuration": disks},
        velocities={"temperature": 1.0},
        equilibrate={"time": 3.0, "tracer": "free"},
        duration=2.0,
        sample_interval=0.5,
    )


def test_sums_over_classes_of_disks_agree_with_those_over_kinds():
    """Masses that do not follow the radii: nearly equal radii are many kinds or one."""
    random = np.random.default_rng(2)
    many = alternating([1.0, 100.0], random.uniform(0.3, 0.3001, 400), 200.0)
    few = alternating([1.0, 100.0], np.full(400, 0.30005), 200.0)
    assert len(kinds_of(few).number) == 3
    assert len(kinds_of(many).number) > 100
    assert pair_rate(many) == pytest.approx(pair_rate(few), rel=0.02)
    friction = [friction_rate(scene, "enskog") for scene in (many, few)]
    # some classes have disks of both masses
    assert friction[0] == pytest.approx(friction[1], rel=0.05)


@pytest.mark.parametrize(("radii", "kinds"), [(145, 145), (146, 145)])
def test_sums_over_kinds_are_no_longer_than_those_over_classes(radii, kinds):
    scene = alternating([1.0], np.resize(np.linspace(0.3, 0.4, radii), 400), 1.0)
    assert len(kinds_of(scene).number) == kinds


def test_the_energy_of_a_species_of_several_masses_is_that_of_its_disks():
    scene = alternating([1.0, 9.0], np.random.default_rng(3).uniform(0.3, 0.4, 400), 1.0)
    runs = bp.simulate(scene, 8, observables=["species_energy"], quiet=True)
    energy = bp.analyse(runs).squeeze().species_energy.isel(time=-1)
    standard_error = 1 / np.sqrt(8 * 400)  # the energy of a disk in two dimensions is exponential
    assert abs(float(energy) - 1.0) < 5 * standard_error


def test_friction_is_measured_for_a_tracer_with_a_velocity_of_its_own():
    scene = alternating([1.0], np.full(400, 0.3), 20.0).replace(
        **{"disks.tracer.velocity": [0.0, 0.0]}, equilibrate=0.0
    )
    runs = bp.simulate(
        scene, 3, engine="langevin", friction="measured", record=["tracer", "velocity"], quiet=True
    )
    assert not runs.velocity.isel(time=0).any()
