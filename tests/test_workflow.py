"""The pipeline as a user starts it: the same bytes however it is run, and nothing run that need not be."""

import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

import forked
from brownpipe.cli import main
from brownpipe.errors import DONE
from brownpipe.storage import read_trajectories
from brownpipe.study import read_study
from brownpipe.study.resources import describe_used

ROOT = Path(__file__).parent.parent
PROGRAM = [sys.executable, "-m", "snakemake"]
SNAKEMAKE = [*PROGRAM, "--snakefile", str(ROOT / "Snakefile"), "--workflow-profile"]
SNAKEMAKE += [str(ROOT / "profiles" / "default")]
SCENE = """\
# a hot tracer
box: {x: [-3.0, 3.0], y: [-3.0, 3.0]}
particles: 10
disks:
  tracer: {radius: 0.3, mass: 1.0}
  species: [{name: bath, count: rest, radius: 0.1, mass: 0.4}]
velocities: {standard_deviation: 2.0}
duration: 1.0
sample_interval: 0.1
"""
STUDY = """\
scenes: [scenes/hot.yaml, scenes/thermal.yaml]
particles: [8, 12]
seeds: 10
batch: 10
"""
PHYSICS = ("*.h5", "*.nc")
PICTURES = ("*.png", "*.svg", "*.csv", "*.txt", "*.html")
pytestmark = pytest.mark.slow


def write_study(folder):
    """Files of a study of four cases in one batch each."""
    (folder / "scenes").mkdir(parents=True)
    (folder / "study.yaml").write_text(STUDY)
    (folder / "scenes" / "hot.yaml").write_text(SCENE)
    (folder / "scenes" / "thermal.yaml").write_text(SCENE.replace("standard_deviation: 2.0", "temperature: 1.6"))
    return folder


def command(folder, *arguments):
    return [*SNAKEMAKE, "--directory", str(folder), "--configfile", str(folder / "study.yaml"), *arguments]


def environment(**more):
    """As in a shell: not as below `make test`, which says how to remove a lock."""
    of_make = ("UNLOCK_COMMAND", "MAKEFLAGS")
    usual = {name: value for name, value in os.environ.items() if name not in of_make}
    return usual | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"} | more


def snakemake(folder, *arguments, fails=False, **more):
    """What snakemake printed. It and the commands of its rules are forked processes."""
    words = command(folder, *arguments)[len(PROGRAM) :]
    path = f"{forked.programs()}:{environment()['PATH']}"
    done = forked.snakemake(*words, cwd=folder.parent, env=environment(**{"PATH": path} | more))
    assert (done.returncode != 0) == fails, done.printed
    return done.printed


def planned(folder, *arguments, **more):
    """How many jobs of each rule a dry run would start."""
    text = snakemake(folder, "--dry-run", *arguments, **more)
    counts = re.findall(r"^(simulate|aggregate|figures) +(\d+)$", text.partition("Job stats:")[2], re.MULTILINE)
    assert counts or re.search(r"^all +1$", text, re.MULTILINE)  # nothing but to show the answer again
    return dict.fromkeys(("simulate", "aggregate", "figures"), 0) | {rule: int(count) for rule, count in counts}


def run_here(folder, commands, patch):
    """Run the commands of a dry run that write a file, in this process instead of one of its own for each."""
    patch.chdir(folder)
    shown = re.findall(r"^Shell command: brownpipe (.*? --output \S+\.(?:h5|nc).*?) 2?> ", commands, re.MULTILINE)
    for words in map(shlex.split, shown):
        assert main(words) == DONE
    return len(shown)


def contents(folder, *patterns):
    """Bytes of all result files of these kinds, by path."""
    files = [file for pattern in patterns for file in (folder / "results").rglob(pattern)]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files if "logs" not in file.parts}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder in which the study was run to its end, and what was printed meanwhile."""
    folder = write_study(tmp_path_factory.mktemp("one") / "study")
    return folder, snakemake(folder, "--cores", "1")


@pytest.fixture
def study(finished, tmp_path):
    """A copy of it, to be changed. It is somewhere else, and as old as the original."""
    return Path(shutil.copytree(finished[0], tmp_path / "elsewhere"))


def test_snakemake_ends_at_once(study):
    """No timer of its scheduler is left, for which Python would wait, and its memory is not searched for garbage."""
    program = (
        "import gc, sys, threading\n"
        "from snakemake.cli import main\n"
        "try:\n"
        "    main()\n"
        "finally:\n"
        "    print('left:', *(one for one in threading.enumerate() if isinstance(one, threading.Timer)))\n"
        "    print('threshold:', gc.get_threshold()[0])\n"
    )
    words = [sys.executable, "-c", program, *command(study, "--cores", "1")[len(PROGRAM) :]]
    done = subprocess.run(words, cwd=study.parent, env=environment(), capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.endswith("left:\nthreshold: 500000\n"), done


# -- the same bytes -------------------------------------------------------------------------------------------------


def test_everything_declared_is_there_and_printed(finished):
    folder, printed = finished
    names = {path.name for path in (folder / "results" / "study" / "figures").iterdir()}
    study = read_study(folder / "study.yaml")
    expected = {f"{name}.{kind}" for name in study.figures for kind in ("png", "svg", "csv")}
    assert names == expected | {"summary.txt", "summary.csv", "provenance.json", "SHA256SUMS"}
    answer = (folder / "results/study/figures/summary.txt").read_text()
    last = "figures and tables: results/study/figures\nall on one page: results/study/report.html\n"
    assert printed.endswith(answer + last) and (folder / "results/study/report.html").is_file()
    with contextlib.chdir(folder):
        used = describe_used(study)
    assert int(re.match(r"7 jobs took .*, (\d+) % of the requested memory", used)[1]) <= 100
    logs = list((folder / "results/study/logs").rglob("*.log"))
    tables = list((folder / "results/study/benchmarks").rglob("*.tsv"))
    assert (len(logs), len(tables)) == (7, 7)
    said = [line for log in logs for line in log.read_text().splitlines()]
    said = [line for line in said if not line.startswith(("brownpipe: compiling ", "brownpipe: waiting "))]
    last = r"results/\S+\.h5: 10? runs?, worst overlap \S+ contact distances, .* of CPU"
    made = [line for line in said if re.fullmatch(last, line)]
    assert len(made) == 4 + 1  # and the run that is replayed
    said = [line for line in said if line not in made]
    remarks = [engine.definition.caution(case) for case in study.cases for engine in study.engines]
    assert sorted(said) == sorted(f"brownpipe: {one}" for one in remarks if one)


def test_the_screen_shows_how_far_the_study_is_and_little_else(finished):
    folder, printed = finished
    before = printed[: printed.index((folder / "results/study/figures/summary.txt").read_text())].splitlines()
    assert before[0].startswith("Using workflow specific profile ")  # Snakemake says so before it asks for a display
    assert before[1].startswith("brownpipe: the study study: 40 runs in 4 jobs of up to 10 seeds: some ")
    of_40 = r"\d+ of 40 runs( \(\d+ %\))?, \d+ s.*"
    shown = rf"simulate: {of_40}|replay: \d+ s|aggregate: ({of_40}|\d+ s)|figures: .*\d+ s.*|brownpipe: .*"
    assert [line for line in before[2:] if not re.fullmatch(shown, line)] == []
    assert {"aggregate", "figures", "simulate"} <= {line.partition(":")[0] for line in before}
    logs = "".join(log.read_text() for log in (folder / ".snakemake" / "log").iterdir())
    assert logs.count("brownpipe simulate ") >= 4  # every command is there
    assert "5 of 8 steps" in logs


def test_the_answer_is_shown_again_though_nothing_is_to_be_done(finished):
    printed = snakemake(finished[0], "--cores", "1")
    answer = (finished[0] / "results/study/figures/summary.txt").read_text()
    last = "figures and tables: results/study/figures\nall on one page: results/study/report.html\n"
    assert printed.partition("\n")[2] == answer + last


@pytest.mark.parametrize("given", [(), ("STUDY=config/small.yaml",)], ids=["default", "another"])
def test_make_report_calls_snakemake_and_make_names_the_command_that_removes_a_lock(given):
    """Make is only asked what it would do: the Snakemake command is the one that a test below runs."""
    surroundings = environment()
    shown = ["make", "--silent", "--eval", "shown: ; @echo $(UNLOCK_COMMAND)", "shown", *given]
    unlock = subprocess.run(shown, cwd=ROOT, env=surroundings, capture_output=True, text=True, check=True).stdout
    command = ["make", "report", *given, "--dry-run"]
    done = subprocess.run(command, cwd=ROOT, env=surroundings, capture_output=True, text=True, check=True).stdout
    study = given[0].partition("=")[2] if given else "config/harrison2020.yaml"
    assert f" --configfile {study} --report report.html" in done
    assert unlock == f".venv/bin/snakemake --unlock --configfile {study}\n"


@pytest.mark.parametrize("target", ["study", "report", "unlock"])
@pytest.mark.parametrize(
    "path", ["my studies/first  one.yaml", "it's (new) & $HOME;.yaml", "~/mine.yaml", "plain.yaml"]
)
def test_make_takes_any_path_of_a_study(path, target):
    given = ["STUDY=" + path.replace("$", "$$"), "REPORT=a page.html", "--dry-run"]
    command = ["make", "--no-print-directory", "--eval", "unlock: ; $(UNLOCK_COMMAND)", target, *given]
    surroundings = environment(HOME="/home/of me")
    done = subprocess.run(command, cwd=ROOT, env=surroundings, capture_output=True, text=True, check=True)
    words = shlex.split(done.stdout.splitlines()[-1])
    study = path.replace("~", "/home/of me")
    assert words[words.index("--configfile") + 1 :] == [study, *["--report", "a page.html"] * (target == "report")]


def test_same_bytes_interrupted_with_two_cores_in_another_folder_zone_and_language(finished, tmp_path):
    """Every file is made far from where `finished` made its own: some before Ctrl-C, the others after it.

    Here each command is a process of its own, as a user starts it.
    """
    folder = write_study(tmp_path / "a folder of another name")
    runs = folder / "results" / "study" / "simulate"  # the run to replay, elsewhere, may come first
    elsewhere = {"TZ": "Asia/Kathmandu", "LC_ALL": "C.UTF-8", "LANG": "de_DE.UTF-8", "PYTHONHASHSEED": "7"}
    first = subprocess.Popen(
        command(folder, "--cores", "1"),
        env=environment(**elsewhere),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        wait_for(lambda: list(runs.rglob("*.h5")))
        printed = snakemake(folder, "--cores", "1", fails=True)  # a second one at once
        assert "LockException" in printed
        assert printed.count("\n") == 2 and printed.endswith(": the same command with --unlock\n")  # after the profile
        assert "Traceback" not in printed
    finally:
        os.killpg(first.pid, signal.SIGINT)  # as Ctrl-C does
        first.wait(60)
    assert first.returncode != 0
    assert not list(folder.rglob("*.part"))
    done = len(list(runs.rglob("*.h5")))
    assert 0 < done < 4
    assert planned(folder)["simulate"] <= 4 - done + 1
    again, surroundings = command(folder, "--cores", "2"), environment(**elsewhere)
    done = subprocess.run(again, cwd=folder.parent, env=surroundings, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    one, two = (contents(each, *PHYSICS, *PICTURES) for each in (finished[0], folder))
    assert one.keys() == two.keys()
    assert [path for path in one if one[path] != two[path]] == []
    figures = read_study(folder / "study.yaml").figures
    assert len(one) == 4 + 1 + 1 + 2 + 3 * len(figures) + 1  # runs, replay, dataset, summary, figures three times, page


def wait_for(condition, seconds=120):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_batches_change_neither_trajectories_nor_results(finished, tmp_path, monkeypatch):
    """Figures and summary are made of the dataset alone, the same bytes of the same dataset."""
    folder = write_study(tmp_path / "study")
    commands = snakemake(folder, "--dry-run", "--until", "aggregate", "--config", "batch=5")
    assert run_here(folder, commands, monkeypatch) == 8 + 1
    one, two = (contents(each, "*.nc") for each in (finished[0], folder))
    assert one == two and len(one) == 1
    of_figures = (ROOT / "workflow" / "rules" / "figures.smk").read_text().partition("    output:")[0]
    dataset = 'dataset=f"{results}/aggregate/{study.name}.nc",'
    assert of_figures.split() == ["rule", "figures:", "input:", dataset, "replay=replay,"]
    for case in ("hot/N8", "thermal/N12"):
        parts = [folder / f"results/study/simulate/{case}/exact/{batch}.h5" for batch in ("0-4", "5-9")]
        whole = finished[0] / f"results/study/simulate/{case}/exact/0-9.h5"
        joined = np.concatenate([tracers(part) for part in parts], axis=1)
        assert joined.tobytes() == tracers(whole).tobytes()


def tracers(path):
    with h5py.File(path) as file:
        return file["particles/tracer/position/value"][()]


# -- nothing that need not be ---------------------------------------------------------------------------------------


ALL = {"simulate": 4, "aggregate": 1, "figures": 1}
NOTHING = dict.fromkeys(ALL, 0)
HALF = {"simulate": 2, "aggregate": 1, "figures": 1}
FIGURES = {"simulate": 0, "aggregate": 0, "figures": 1}
ANALYSIS = {"simulate": 0, "aggregate": 1, "figures": 1}
REORDERED = "# a comment\n" + "".join(
    sorted(["duration: 1\n", "sample_interval: 1e-1\n", *re.findall(r"^(?:box|particles|velocities).*\n", SCENE, re.M)])
    + re.findall(r"^disks:\n(?:  .*\n)*", SCENE, re.M)
)


@pytest.mark.parametrize(
    ("file", "old", "new", "jobs"),
    [
        ("scenes/hot.yaml", SCENE, REORDERED, NOTHING),
        ("scenes/hot.yaml", "mass: 0.4", "mass: 0.5", HALF),
        ("scenes/thermal.yaml", "duration: 1.0", "duration: 1.1", HALF),
        ("study.yaml", "seeds: 10", "seeds: 20", ALL),  # the second batch of each case
        ("study.yaml", "seeds: 10", "seeds: 10\nfit_windows: [[0.2, 1.0]]", ANALYSIS),
        ("study.yaml", "seeds: 10", "seeds: 10\nfigures: [msd]", FIGURES),
    ],
)
def test_a_change_runs_what_depends_on_it_and_nothing_else(study, file, old, new, jobs):
    text = (study / file).read_text()
    assert old in text
    (study / file).write_text(text.replace(old, new))
    assert planned(study) == jobs


@pytest.mark.promise(
    "a result is deleted, or a figure is added to a finished study",
    "The next run makes every missing file again that the study promises, and what is made from it.",
)
@pytest.mark.parametrize(
    ("deleted", "jobs"),
    [
        ("simulate/hot/*/*/0-9.h5", HALF),
        ("aggregate/study.nc", ANALYSIS),
        ("figures/health.svg", FIGURES),
        ("replay/hot/*/*/0-0.h5", FIGURES),
        ("figures/summary.csv", FIGURES),
        ("report.html", FIGURES),
    ],
)
def test_what_was_deleted_is_made_again(study, deleted, jobs):
    for file in (study / "results" / "study").glob(deleted):
        file.unlink()
    assert planned(study) == jobs


@pytest.mark.parametrize(
    ("source", "jobs"),
    [
        ("engines/exact/events.py", ALL),
        ("analysis/resampling.py", ANALYSIS),
        ("figures/msd.py", FIGURES),
        ("cli.py", NOTHING),
    ],
)
def test_a_changed_source_runs_its_step_again(study, tmp_path, source, jobs):
    package = Path(shutil.copytree(ROOT / "src", tmp_path / "src")) / "brownpipe"
    with open(package / source, "a") as file:
        file.write("# another version\n")
    assert planned(study, PYTHONPATH=str(package.parent)) == jobs


@pytest.mark.parametrize(
    ("package", "jobs"),
    [("numba", ALL), ("llvmlite", ALL), ("matplotlib", FIGURES)],
)
def test_a_changed_version_runs_its_step_again(study, tmp_path, package, jobs):
    told = tmp_path / "site" / f"{package}-99.dist-info" / "METADATA"
    told.parent.mkdir(parents=True)
    told.write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 99\n")
    assert planned(study, PYTHONPATH=f"{tmp_path / 'site'}:{ROOT / 'src'}") == jobs


def test_more_seeds_leave_the_files_of_the_others_alone(study):
    before = {path: path.stat().st_mtime_ns for path in study.rglob("*.h5")}
    one_case = ("scenes=scenes/hot.yaml", "particles=8")
    snakemake(study, "--cores", "2", "--until", "simulate", "--config", "seeds=14", *one_case)
    after = {path: path.stat().st_mtime_ns for path in study.rglob("*.h5")}
    assert {path.name for path in after.keys() - before.keys()} == {"10-13.h5"}
    assert before.items() <= after.items()


def test_the_answer_is_printed_by_what_makes_it(study):
    (dataset,) = study.rglob("*.nc")
    dataset.unlink()
    assert "figures and tables" not in snakemake(study, "--cores", "1", "--until", "aggregate")
    assert dataset.exists()


@pytest.fixture(scope="module")
def of_two_engines(tmp_path_factory):
    """A study of one case by two engines with a tolerance in place of seeds, and what was printed meanwhile."""
    folder = write_study(tmp_path_factory.mktemp("two") / "study")
    engines = "engines: [exact, {name: langevin, friction: enskog}]\n"
    (folder / "study.yaml").write_text(f"scenes: scenes/thermal.yaml\ntolerance: 20%\nfigures: [health]\n{engines}")
    dry = snakemake(folder, "--dry-run")
    assert not (folder / "results").exists()
    return folder, dry, snakemake(folder, "--cores", "1")


def settled(folder):
    """The number of runs that was determined."""
    return yaml.safe_load((folder / "results/study/plan.yaml").read_text())["runs"]


def test_a_study_of_two_engines(of_two_engines):
    folder, _, printed = of_two_engines
    runs, results = settled(folder), folder / "results" / "study"
    files = {str(file.relative_to(results / "simulate")) for file in results.rglob(f"0-{runs - 1}.h5")}
    assert files == {f"thermal/N10/{label}/0-{runs - 1}.h5" for label in ("exact", "langevin-enskog")}
    assert re.search(rf"^thermal +10 +exact +{runs} ", printed, re.MULTILINE)
    assert re.search(rf"^thermal +10 +langevin-enskog +{runs} ", printed, re.MULTILINE)
    log = (results / f"logs/simulate/thermal/N10/langevin-enskog/0-{runs - 1}.log").read_text()
    assert "langevin is rough here" in log
    assert planned(folder) == NOTHING


def test_a_tolerance_takes_one_command_and_its_dry_run_no_pilot(of_two_engines):
    """The pilot is announced on the screen before anything else, and is not run again."""
    folder, dry, printed = of_two_engines
    assert "brownpipe: the study study: 25 runs assumed; pilot runs, some " in dry
    assert "/thermal/N10/exact/0-24.h5" in dry
    announced = "determine how many runs a tolerance of 20 % of msd needs"
    assert printed.index(announced) < printed.index(" runs in 2 jobs of up to ")
    # all files are those of the runs determined, and of the run replayed
    assert {file.name for file in folder.rglob("*.h5")} == {f"0-{settled(folder) - 1}.h5", "0-0.h5"}
    again = snakemake(folder, "--dry-run")
    assert announced not in again and "assumed" not in again


def test_another_figure_of_a_finished_study_is_drawn(of_two_engines, tmp_path):
    folder = Path(shutil.copytree(of_two_engines[0], tmp_path / "copy"))
    text = (folder / "study.yaml").read_text()
    (folder / "study.yaml").write_text(text.replace("[health]", "[health, msd]"))
    assert planned(folder) == FIGURES


@pytest.mark.parametrize(
    ("source", "simulated"),
    [("engines/langevin/step.py", 1), ("engines/friction.py", 1), ("engines/exact/events.py", 2)],
)
def test_a_changed_engine_runs_its_own_jobs_again(of_two_engines, tmp_path, source, simulated):
    package = Path(shutil.copytree(ROOT / "src", tmp_path / "src")) / "brownpipe"
    with open(package / source, "a") as file:
        file.write("# another version\n")
    jobs = {"simulate": simulated, "aggregate": 1, "figures": 1}
    assert planned(of_two_engines[0], PYTHONPATH=str(package.parent)) == jobs


def test_what_is_measured_in_the_runs_is_passed_on(study, monkeypatch):
    measured = ["--config", "observables=[square_displacement,species_energy]", "record=none"]
    assert planned(study, "--until", "simulate", *measured) == {"simulate": 4, "aggregate": 0, "figures": 0}
    one_case = ("scenes=scenes/hot.yaml", "particles=8")
    commands = snakemake(study, "--dry-run", "--until", "simulate", *measured, *one_case)
    assert run_here(study, commands, monkeypatch) == 1
    with h5py.File(study / "results/study/simulate/hot/N8/exact/0-9.h5") as file:
        assert file["observables/run/species_energy"].shape == (10, 11, 2)
        assert "observables/run/square_displacement" in file and "particles/tracer" not in file


@pytest.mark.promise(
    "a folder or file called -rf, or with blanks, quotes, line feeds, braces, $(...) or ; in its name",
    "Every path in a command of the workflow is one word of the shell, no option, and nothing in it is executed.",
)
def test_a_list_of_disks_in_a_folder_with_spaces(tmp_path):
    scenes = "-my scenes; false\n$(touch hit) `touch hit` {wildcards} {{x}} 'q\" \x1b[2J & touch hit &"
    folder = tmp_path / "-study {x}; false \n'\" \udcff"
    (folder / scenes).mkdir(parents=True)
    shutil.copy(ROOT / "tests" / "scenes" / "pair_head_on.yaml", folder / scenes / "pair.yaml")
    (folder / "study.yaml").write_text(f"scenes: {json.dumps(f'{scenes}/pair.yaml')}\nseeds: 1\nfigures: [health]\n")
    snakemake(folder, "--cores", "1")
    assert not list(tmp_path.rglob("hit"))
    assert (folder / "results/study/simulate/pair/N2/exact/0-0.h5").is_file()
    assert re.search(r"^pair +2 +1 ", (folder / "results/study/figures/summary.txt").read_text(), re.MULTILINE)


# -- what goes wrong ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--config", "sed=3"], "study.yaml with sed replaced: unknown key 'sed'; did you mean seeds?"),
        (["--config", "batch=-1"], "batch: must be an integer from 1 to 10000000 or auto, not -1"),
        (["--config", "scenes=scenes/absent.yaml"], "scenes/absent.yaml: cannot be read: No such file or directory"),
    ],
)
def test_a_wrong_study_is_refused_in_one_line(tmp_path, arguments, message):
    printed = snakemake(write_study(tmp_path / "study"), "--dry-run", *arguments, fails=True)
    lines = [line for line in printed.splitlines() if not line.startswith("Using ")]
    assert len(lines) == 1
    assert lines[0].startswith("brownpipe: ")
    assert message in lines[0]
    assert not (tmp_path / "study" / "results").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--configfile", "study.yaml", "latin1.yaml"], "latin1.yaml: not text: byte 3 is not UTF-8"),
        (["--configfile", "scenes/hot.yaml"], "hot.yaml: is a scene, not a study; run it with brownpipe simulate "),
        (["--config", "box.x=3"], "--config: must be KEY=VALUE, with a key of the study, like seeds=100"),
    ],
)
def test_what_is_no_study_is_refused_in_one_line(tmp_path, arguments, message):
    """Before the Snakefile is read (the first and the last), and by it; others: test_screen.py."""
    folder = write_study(tmp_path / "study")
    (folder / "latin1.yaml").write_bytes("café: 1\n".encode("latin-1"))
    done = forked.snakemake(*SNAKEMAKE[len(PROGRAM) :], "-n", *arguments, cwd=folder, env=environment())
    lines = [line for line in done.printed.splitlines() if not line.startswith("Using ")]
    assert done.returncode != 0 and len(lines) == 1, done.printed
    assert lines[0].startswith("brownpipe: ") and message in lines[0]


def test_a_failed_job_says_why(tmp_path):
    folder = write_study(tmp_path / "study")
    crowd = "particles: [170]\nseeds: 1\nscenes: scenes/hot.yaml\n"  # they would fit, but not at random
    (folder / "study.yaml").write_text(crowd)
    (folder / "scenes" / "hot.yaml").write_text(SCENE.replace("[-3.0, 3.0]", "[-1.5, 1.5]"))
    printed = snakemake(folder, "--cores", "1", fails=True)
    assert printed.splitlines()[-1].startswith("    brownpipe: hot, N = 170, seed 0: disks: ")  # below all else
    assert "brownpipe: the rule simulate failed: brownpipe simulate scenes/hot.yaml --particles 170" in printed
    assert "Traceback" not in printed
    assert contents(folder, *PHYSICS) == {}


# -- report and style -----------------------------------------------------------------------------------------------


def test_report_is_one_page_that_begins_with_the_answer(finished, tmp_path):
    snakemake(finished[0], "--report", str(tmp_path / "report.html"))
    page = (tmp_path / "report.html").read_text()
    assert not re.search(r"<(?:script|link|img)[^>]*(?:src|href)=.?https?:", page)
    first = page[page.index("workflow_desc") :].partition("\n")[0]
    assert re.search(r"hot +8 +10 +", first)
    assert "<svg" in first
    for caption in (
        "Mean squared displacement of the tracer",
        "Displacement distribution",
        "Dependence on the number",
        "Health of every",
    ):
        assert caption in page


def test_the_run_in_the_page_is_bit_identical_to_that_of_the_study(finished):
    results = finished[0] / "results" / "study"
    again = read_trajectories(results / "replay/hot/N12/exact/0-0.h5").ensemble
    runs = read_trajectories(results / "simulate/hot/N12/exact/0-9.h5").ensemble
    np.testing.assert_array_equal(again.whole[0].position[:, 0], runs.tracer.position[:, 0])
    assert again.observables["pair_collisions"][0] == runs.observables["pair_collisions"][0] > 0
    assert 'class="brownpipe-replay"' in (results / "report.html").read_text()


def test_every_lint_left_has_a_reason():
    printed = forked.snakemake("--snakefile", ROOT / "Snakefile", "--lint", cwd=ROOT, env=environment()).printed
    lints = set(re.findall(r"^ +\* (.*):$", printed, re.MULTILINE))
    assert lints
    assert [lint for lint in lints if lint not in (ROOT / "CONTRIBUTING.md").read_text()] == []


@pytest.mark.parametrize(
    "file", [ROOT / "Snakefile", *sorted((ROOT / "workflow" / "rules").iterdir())], ids=lambda p: p.name
)
def test_the_workflow_only_connects(file):
    assert not re.search(r"^\s*(?:def\b|run:|script:)|\blambda\b", file.read_text(), re.MULTILINE)
