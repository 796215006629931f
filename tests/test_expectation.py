"""A study knows which runs each of its trajectory files holds: exchanged files are refused by name."""

import shutil
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.engines.request import Request
from brownpipe.errors import DONE, WRONG_REQUEST, AnalysisError
from brownpipe.scene import read_scene
from brownpipe.storage import read_dataset, read_outline
from brownpipe.storage.expected import difference
from brownpipe.study.expectation import expected_files, read_settled
from brownpipe.tradeoff import measure

SCENE = """\
box: {x: [-3.0, 3.0], y: [-3.0, 3.0]}
particles: 6
disks:
  tracer: {radius: 0.3, mass: 1.0}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {temperature: 1.6}
duration: 0.4
sample_interval: 0.1
"""
STUDY = "scenes: scenes/{}.yaml\nparticles: [5, 6]\nseeds: 4\nbatch: 2\nfit_windows: [[0.1, 0.4]]\n"
MEASURED = ("--observables", "square_displacement")
OTHERS = {  # runs that no file of the study holds: the scene, and options of `brownpipe simulate`
    "another scene": ("cold", "--particles", "5", "--seeds", "0-1"),
    "another scene of this name": ("other/hot", "--particles", "5", "--seeds", "0-1"),
    "another number of disks": ("hot", "--particles", "7", "--seeds", "0-1"),
    "another engine": ("hot", "--particles", "5", "--seeds", "0-1", "--engine", "langevin", "--friction", "enskog"),
    "fewer seeds": ("hot", "--particles", "5", "--seeds", "0"),
    "more seeds": ("hot", "--particles", "5", "--seeds", "0-2"),
    "other seeds": ("hot", "--particles", "5", "--seeds", "7-8"),
    "no tracks": ("hot", "--particles", "5", "--seeds", "0-1", "--record", "none", *MEASURED),
    "tracks of all disks": ("hot", "--particles", "5", "--seeds", "0-1", "--record", "all"),
    "all collisions": ("hot", "--particles", "5", "--seeds", "0-1", "--record", "events"),
    "an observable": ("hot", "--particles", "5", "--seeds", "0-1", *MEASURED),
}


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A folder with the four trajectory files of a study, and the file of each of OTHERS."""
    folder = tmp_path_factory.mktemp("exchanged")
    (folder / "scenes" / "other").mkdir(parents=True)
    (folder / "study.yaml").write_text(STUDY.format("hot"))
    (folder / "scenes" / "hot.yaml").write_text(SCENE)
    (folder / "scenes" / "cold.yaml").write_text(SCENE.replace("1.6", "0.8"))
    (folder / "scenes" / "other" / "hot.yaml").write_text(SCENE.replace("mass: 0.4", "mass: 0.5"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for path, request in expected_files(read_settled("study.yaml")):
            seeds, particles = f"{request.seeds[0]}-{request.seeds[-1]}", str(request.scene.particles)
            assert simulated("hot", "--particles", particles, "--seeds", seeds, "--output", path) == DONE
        for name, (scene, *options) in OTHERS.items():
            assert simulated(scene, *options, "--output", f"{name}.h5") == DONE
    return folder


@pytest.fixture
def study(original, tmp_path, monkeypatch):
    """A copy of it, which is the working directory; the trajectory files of the study."""
    monkeypatch.chdir(shutil.copytree(original, tmp_path / "copy"))
    return sorted(Path("results").rglob("*.h5"))


@pytest.fixture
def before(study):
    """The dataset of the study as it was made."""
    assert aggregated("before.nc") == DONE
    return Path("before.nc")


def simulated(scene, *options):
    return main(["simulate", f"scenes/{scene}.yaml", *options])


def aggregated(output):
    return main(["aggregate", "--study", "study.yaml", "--output", output])


@pytest.mark.slow
@pytest.mark.promise(
    "a trajectory file is replaced by one of another case or study, or two change places",
    "The analysis of a study names any file that holds other runs than the study asks for, and makes no dataset.",
)
def test_every_exchange_of_files_is_refused_by_name(study, before, capsys):
    """Each file of the study in place of each other one; OTHERS in place of the one that they are most like."""
    given = {path: path.read_bytes() for path in [*study, *Path().glob("*.h5")]}
    assert len(study) == 4 and len(given) == 4 + len(OTHERS)
    for place in study:
        others = given.keys() - {place} if place == study[0] else {*study} - {place}
        for other in others:
            capsys.readouterr()
            place.write_bytes(given[other])
            status, told = aggregated("after.nc"), capsys.readouterr().err
            assert (status, told.count("\n")) == (WRONG_REQUEST, 1), (place, other)
            assert told.startswith(f"brownpipe: {place}: holds ") and told.endswith(
                "; delete it and run the study again\n"
            )
            assert not Path("after.nc").exists()
        place.write_bytes(given[place])
    assert aggregated("after.nc") == DONE
    assert read_dataset("after.nc").identical(read_dataset(before))


@pytest.mark.slow
def test_an_engine_of_the_tracer_alone_holds_what_it_can_measure(original, tmp_path, monkeypatch):
    """The Langevin engine beside the exact one: it has no energies of the species, and so no average without them."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(original / "scenes", "scenes")
    Path("scenes/hot.yaml").write_text(f"{SCENE}equilibrate: {{time: 0.1, tracer: free}}\n")
    options = {"square_displacement,species_energy": "origins", "species_energy": "runs"}
    engines = "engines: [exact, {name: langevin, friction: enskog}]\n"
    for names, average in options.items():
        asked = f"observables: [{names}]\naverage: {average}\nseeds: 2\n"
        Path("study.yaml").write_text(f"scenes: scenes/hot.yaml\n{engines}{asked}")
        for path, request in expected_files(read_settled("study.yaml")):
            told = ["--observables", names, "--average", average, "--engine", *request.engine.options.split()]
            assert simulated("hot", "--seeds", "0-1", *told, "--output", path) == DONE
        assert aggregated("after.nc") == DONE
        shutil.rmtree("results")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("another scene", "holds runs of the scene cold, not of hot"),
        ("another scene of this name", "holds runs of another scene that is called hot, too"),
        ("another number of disks", "holds runs with N = 7, not 5"),
        ("another engine", "holds runs of the engine langevin --friction enskog, not of exact"),
        ("more seeds", "holds the seeds 0-2, not 0-1"),
        ("tracks of all disks", "holds runs with --record all,tracer, not tracer"),
        ("an observable", "holds runs with --observables square_displacement, not none"),
    ],
)
def test_the_message_says_in_what_the_runs_differ(study, name, message):
    place = Path("results/study/simulate/hot/N5/exact/0-1.h5")
    place.write_bytes(Path(f"{name}.h5").read_bytes())
    with pytest.raises(AnalysisError, match=message):
        measure(expected_files(read_settled("study.yaml")))


def test_a_missing_file_is_named(study, capsys):
    study[2].unlink()
    assert aggregated("after.nc") == WRONG_REQUEST
    assert capsys.readouterr().err == f"brownpipe: {study[2]}: cannot be read: No such file or directory\n"


@pytest.mark.slow
def test_other_values_of_keys_are_given_as_to_snakemake(study, capsys):
    words = ["aggregate", "--study", "study.yaml", "--output", "after.nc", "--config"]
    assert main([*words, "particles=[5]", "seeds=0-1"]) == DONE
    after = read_dataset("after.nc")
    assert (after.sizes["seed"], after.particles.values.tolist()) == (2, [5])
    capsys.readouterr()
    assert main([*words, "seeds=6"]) == WRONG_REQUEST
    assert "results/study/simulate/hot/N5/exact/4-5.h5: cannot be read" in capsys.readouterr().err


@pytest.mark.slow
def test_the_study_says_how_its_files_are_analysed(study, before):
    windows = read_dataset(before).window.values.tolist()
    assert windows == ["[0.1, 0.4]"]
    assert main(["aggregate", *map(str, study), "--output", "same.nc", "--fit-windows", "0.1:0.4"]) == DONE
    assert Path("same.nc").read_bytes() == before.read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "FILE.h5: missing; give trajectory files, or a study with --study"),
        (["x.h5", "--study", "study.yaml"], "--study study.yaml: must not be given with files (x.h5)"),
        (["x.h5", "--config", "seeds=3"], "--config: must not be given without --study"),
        (
            ["--study", "study.yaml", "--config", "sed=3"],
            "study.yaml with sed replaced: unknown key 'sed'; did you mean",
        ),
    ],
)
def test_files_and_study_exclude_each_other(study, capsys, words, message):
    assert main(["aggregate", *words, "--output", "after.nc"]) == WRONG_REQUEST
    assert capsys.readouterr().err.startswith(f"brownpipe: {message}")


def test_a_file_without_a_finished_run_has_no_record_to_compare(tmp_path, monkeypatch):
    """No disk finds a place: the run is recorded as failed, and nothing else of it."""
    monkeypatch.chdir(tmp_path)
    Path("full.yaml").write_text(SCENE.replace("particles: 6", "particles: 400"))
    options = ("--seeds", "0", "--record", "all,events", "--allow-failed", "all", "--output", "full.h5")
    assert main(["simulate", "full.yaml", *options]) == DONE
    request = Request(read_scene("full.yaml"), Engine("exact"), [0], frozenset({"tracer", "all", "events"}))
    assert difference(read_outline("full.h5"), request) is None
    assert difference(read_outline("full.h5"), request._replace(seeds=[1])) == "holds the seeds 0, not 1"
