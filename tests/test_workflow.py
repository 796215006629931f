"""The pipeline as a user starts it: the same bytes however it is run, and nothing run that need not
be.
"""

import fcntl
import re
import shlex
import shutil
import subprocess
import sys
from itertools import chain, product
from pathlib import Path

import h5py
import numpy as np
import pytest

import forked
from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST
from brownpipe.storage.files import write_file
from brownpipe.study import read_study
from pipeline import ROOT, SCENE, age_backwards, environment, snakemake

STUDY = """\
scenes: [scenes/hot.yaml, scenes/thermal.yaml]
particles: [8, 12]
seeds: 10
batch: 10
figures: [msd, health]
"""
PICTURES = ("*.png", "*.svg", "*.csv", "*.txt", "*.html")
pytestmark = pytest.mark.slow


def write_study(folder):
    """Files of a study of four cases in one batch each."""
    (folder / "scenes").mkdir(parents=True)
    (folder / "study.yaml").write_text(STUDY)
    (folder / "scenes" / "hot.yaml").write_text(SCENE)
    (folder / "scenes" / "thermal.yaml").write_text(
        SCENE.replace("standard_deviation: 2.0", "temperature: 1.6")
    )
    return folder


def planned(folder, *arguments, **more):
    """How many jobs of each rule a dry run would start."""
    text = snakemake(folder, "--dry-run", *arguments, **more)
    counts = re.findall(
        r"^(simulate|aggregate|figures) +(\d+)$", text.partition("Job stats:")[2], re.MULTILINE
    )
    assert re.search(r"^all +1$", text, re.MULTILINE)  # the answer is always shown
    assert text.count(" mem_mb=") == text.count(
        " log: "
    )  # all but the answer ask a queue for memory and time
    none = dict.fromkeys(("simulate", "aggregate", "figures"), 0)
    return none | {rule: int(count) for rule, count in counts}


def contents(folder, *patterns):
    """Bytes of all result files of these kinds, by path."""
    found = {}
    for file in chain.from_iterable(map((folder / "results").rglob, patterns)):
        if "logs" not in file.parts and not file.name.startswith("made_from"):
            found[str(file.relative_to(folder))] = file.read_bytes()
    return found


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder in which the study was run to its end, and what was printed meanwhile."""
    folder = write_study(tmp_path_factory.mktemp("one") / "study")
    return folder, snakemake(folder, "--cores", "1")


@pytest.fixture
def study(finished, tmp_path):
    """A copy of it, to be changed. It is somewhere else, and as old as the original."""
    return Path(shutil.copytree(finished[0], tmp_path / "elsewhere"))


# -- what there is ---------------------------------------------------------------------------------


def test_everything_declared_is_there_and_the_answer_is_printed_last(finished):
    folder, printed = finished
    names = {path.name for path in (folder / "results/study/figures").iterdir()}
    figures = read_study(folder / "study.yaml").figures
    kinds = ("png", "svg", "csv")
    expected = {f"{name}.{kind}" for name, kind in product(figures, kinds)}
    assert expected | {"summary.txt", "summary.csv", "provenance.json"} < names
    answer = (folder / "results/study/figures/summary.txt").read_text()
    last = "figures and tables: results/study/figures\nall on one page: results/study/report.html\n"
    assert printed.endswith(answer + last) and (folder / "results/study/report.html").is_file()
    before = printed[: printed.index(answer)].splitlines()
    assert before[1].startswith("brownpipe: the study study: 40 runs in 4 jobs, some ")
    shown = r"(simulate|aggregate|figures): .*\d+ s.*|brownpipe: .*"
    assert [line for line in before[2:] if not re.fullmatch(shown, line)] == []
    assert (
        snakemake(folder, "--cores", "1").partition("\n")[2] == answer + last
    )  # shown again, nothing is made
    assert main(["verify", str(folder / "results/study")]) == DONE


def test_same_bytes_with_two_cores_in_another_folder_zone_and_language_and_in_other_batches(
    finished, tmp_path
):
    """Zone, language and the order of Python's sets are others where figures are drawn, on two
    cores, too.
    """
    folder = write_study(tmp_path / "a folder of another name")
    (folder / "study.yaml").write_text(STUDY.replace("batch: 10", "batch: 5"))
    names = (
        "aggregate/made_from_me",
        "aggregate/made_from_0123456789ab",
        "figures/drawn_from_0123456789ab",
    )
    mine, *older = (folder / f"results/study/{name}.txt" for name in names)
    for file in (mine, *older):
        write_file(file, b"")
    snakemake(folder, "--cores", "2")
    assert mine.is_file() and not any(file.exists() for file in older)
    (folder / "results/study/figures/msd.svg").unlink()
    elsewhere = {
        "TZ": "Asia/Kathmandu",
        "LC_ALL": "C.UTF-8",
        "LANG": "de_DE.UTF-8",
        "PYTHONHASHSEED": "7",
    }
    again = f"brownpipe {' '.join(due(folder, 'figures'))} --cores 2"
    subprocess.run(
        again, shell=True, cwd=folder, env=environment(**elsewhere), check=True, timeout=300
    )
    one = contents(finished[0], "*.nc", *PICTURES)
    two = contents(folder, "*.nc", *PICTURES)
    assert one.keys() == two.keys() and len(one) >= 10
    assert [path for path in one if one[path] != two[path]] == []
    for whole in (finished[0] / "results/runs").rglob("*.h5"):
        batches = folder / whole.relative_to(finished[0]).parent
        parts = [batches / "0-4.h5", batches / "5-9.h5"]
        position, *joined = (h5py.File(path)["position"][()] for path in (whole, *parts))
        assert np.concatenate(joined, axis=1).tobytes() == position.tobytes()


def test_a_study_from_the_shell_of_a_notebook_without_a_home_in_a_locale_without_its_letters(
    tmp_path,
):
    """A backend that is not installed here, a home that cannot be made, and file names in ASCII."""
    (tmp_path / "hot.yaml").write_text(SCENE)
    texts = "title: ζ in the Ærø box\nnote: '\"ζ\" is 0.2'\n"
    study = "scenes: hot.yaml\nseeds: 3\nfigures: [msd]\n"
    (tmp_path / "odd.yaml").write_text(study + texts, "utf-8")
    apart = environment(
        MPLBACKEND="module://no_such_package.backend_inline",
        HOME="/dev/null/nobody",
        LC_ALL="C",
        PYTHONCOERCECLOCALE="0",
        PYTHONUTF8="0",
    )
    apart.pop("XDG_CACHE_HOME", None)
    run = [Path(sys.executable).parent / "brownpipe", "run", "odd.yaml", "-j1"]
    done = subprocess.run(run, cwd=tmp_path, env=apart, capture_output=True, timeout=300)
    assert done.returncode == DONE and b"Traceback" not in done.stderr, done.stderr.decode()
    page = (tmp_path / "results/odd/report.html").read_text("utf-8")
    assert "ζ in the Ærø box" in page and "ζ&#34; is 0.2" in page.replace("&quot;", "&#34;")
    assert (tmp_path / ".snakemake/cache/snakemake").is_dir()


# -- what is made again: by content, not by times or Snakemake's records ---------------------------


ALL = {"simulate": 4, "aggregate": 1, "figures": 1}
NOTHING = dict.fromkeys(ALL, 0)
HALF = {"simulate": 2, "aggregate": 1, "figures": 1}
ONE = {"simulate": 1, "aggregate": 1, "figures": 1}
FIGURES = {"simulate": 0, "aggregate": 0, "figures": 1}
ANALYSIS = {"simulate": 0, "aggregate": 1, "figures": 1}
CHANGES = (
    ("scenes/hot.yaml", "# a hot tracer", "# another comment", NOTHING),
    ("study.yaml", "[msd, health]", "[msd]", FIGURES),
    ("results/study/figures/health.svg", "", "deleted", FIGURES),
    ("scenes/hot.yaml", "mass: 0.4", "mass: 0.5", HALF),
    ("study.yaml", "seeds: 10", "seeds: 20", ALL),  # the second batch of each case
    ("study.yaml", "seeds: 10", "seeds: 7", ANALYSIS),
    ("results/runs/hot/N8/*/0-9.h5", "", "deleted", ONE),
    ("results/study/aggregate/study.nc", "", "deleted", ANALYSIS),
)


@pytest.mark.parametrize(
    ("file", "old", "new", "jobs", "is_remembered"),
    [(*change, False) for change in CHANGES] + [(*change, True) for change in CHANGES[:3]],
)
def test_a_change_makes_what_depends_on_it_and_nothing_else(
    study, file, old, new, jobs, is_remembered
):
    """Also without `.snakemake`, with results from the future, and whatever is made from others
    older than these.
    """
    if not is_remembered:
        age_backwards(study)
    (path,) = study.glob(file)
    if new == "deleted":
        path.unlink()
    else:
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))
    assert planned(study) == jobs


@pytest.mark.parametrize(
    ("source", "jobs"),
    [
        ("engines/exact/events.py", ALL),
        ("analysis/resampling.py", ANALYSIS),
        ("figures/msd.py", FIGURES),
        ("cli.py", NOTHING),
        ("../numpy-99.dist-info/METADATA", NOTHING),  # another version of a package
    ],
)
def test_a_changed_source_runs_its_step_again(study, tmp_path, source, jobs):
    package = Path(shutil.copytree(ROOT / "src", tmp_path / "src")) / "brownpipe"
    (package / source).parent.mkdir(exist_ok=True)
    with open(package / source, "a") as file:
        file.write("Version: 99\n" if "METADATA" in source else "# another version\n")
    assert planned(study, PYTHONPATH=str(package.parent)) == jobs


def test_added_seeds_run_alone_and_other_studies_and_keys_use_the_same_runs(study):
    """The note has braces and begins as an option does: to no program on the way it means
    anything.
    """
    before = {path: path.stat().st_mtime_ns for path in study.glob("results/**/*.*")}
    one_case = (
        "scenes=scenes/hot.yaml",
        "particles=8",
        "batch=auto",
        "figures=[health]",
        "note=--gamma_{0}",
    )
    snakemake(study, "--cores", "2", "--config", "seeds=14", *one_case)
    after = {path: path.stat().st_mtime_ns for path in study.glob("results/**/*.*")}
    added = [path for path in after.keys() - before.keys() if path.suffix == ".h5"]
    assert {path.name for path in added} == {"10-13.h5"}
    assert before.items() <= after.items()
    (page,) = (study / "results").glob("study+*seeds=14*/report.html")
    assert "--gamma_{0}" in page.read_text()
    others = [name for name in contents(study, "study/**/*.*") if "drawn_from" not in name]
    for name in others:  # put back from elsewhere
        (study / name).write_text("other")
    printed = snakemake(study, "--cores", "1", status=FAILED)
    assert [name for name in others if f"{name}: FAILED" not in printed] == []
    assert "Made by brownpipe" not in printed
    shutil.copy(study / "study.yaml", study / "other.yaml")
    assert planned(study, "--configfile", str(study / "other.yaml")) == ANALYSIS


def due(study, verb, target="all"):
    """The words of the only job of a verb that is due."""
    (command,) = re.findall(rf"brownpipe ({verb} .*?) > ", snakemake(study, "--dry-run", target))
    return shlex.split(command)


def test_a_file_in_the_place_of_another_and_what_is_edited_meanwhile_are_refused(
    study, monkeypatch, capsys
):
    monkeypatch.chdir(study)
    one, other = sorted(Path("results/runs/hot").rglob("*.h5"))
    dataset = Path("results/study/aggregate/study.nc")
    figure = Path("results/study/figures/health.svg")
    figure.unlink()
    command = due(study, "figures")
    assert main(["aggregate", str(one), "--output", str(dataset)]) == DONE
    assert (
        main(command) == WRONG_REQUEST
        and f"{dataset}: is not of this study" in capsys.readouterr().err
    )
    Path("study.yaml").write_text(STUDY.replace("seeds: 10", "seeds: 7"))
    command = due(study, "aggregate", "figures")  # the dataset that is there is of ten seeds
    Path("study.yaml").write_text(STUDY)
    for words in (command, ["tradeoff", *command[2:]]):
        assert (
            main(words) == WRONG_REQUEST
            and "study.yaml: has changed since" in capsys.readouterr().err
        )
    Path("study.yaml").write_text(STUDY.replace("seeds: 10", "seeds: 7"))
    shutil.copy(one, other)
    assert (
        main(command) != DONE
        and f"{other}: holds other runs than its name says" in capsys.readouterr().err
    )
    other.unlink()
    command = due(study, "simulate")
    Path("scenes/hot.yaml").write_text(SCENE.replace("mass: 0.4", "mass: 0.5"))
    assert (
        main(command) == WRONG_REQUEST
        and "scenes/hot.yaml: has changed since" in capsys.readouterr().err
    )


def test_the_lock_of_a_killed_snakemake_is_no_obstacle_and_that_of_a_living_one_is(study):
    file = next((study / "results/runs/hot/N8").rglob("*.h5"))
    file.unlink()
    words = "--cores", "1", str(file.relative_to(study))
    (study / ".snakemake/locks").mkdir()
    for name in ("0.input.lock", "0.output.lock"):
        (study / ".snakemake/locks" / name).write_text(f"{words[-1]}\n")
    with open(study / ".snakemake/brownpipe.lock", "w") as alive:
        fcntl.flock(alive, fcntl.LOCK_SH)
        assert "or if there is none: brownpipe run STUDY --unlock" in snakemake(
            study, *words, status=FAILED
        )
    snakemake(study, *words)
    assert file.is_file()
    shutil.rmtree(
        study / "results/study/figures"
    )  # killed while a job went on, which is now made again: forced
    assert planned(study, "--forcerun", "aggregate") == ANALYSIS


# -- what goes wrong -------------------------------------------------------------------------------


def test_a_wrong_study_is_refused_in_one_line(tmp_path):
    folder = write_study(tmp_path / "study")
    unknown = (
        ["--dry-run", "--config", "sed=3"],
        "study.yaml (replaced): sed: unknown key; did you mean",
    )
    for words, wrong in (
        unknown,
        (["--cores", "1", "tradeoff_figures"], "the study study: has no trade-off; must "),
    ):
        printed = snakemake(folder, *words, status=WRONG_REQUEST)
        (line,) = (line for line in printed.splitlines() if not line.startswith("Using "))
        assert line.startswith("brownpipe: ") and wrong in line
    assert not (tmp_path / "study" / "results").exists()


# -- style -----------------------------------------------------------------------------------------


def test_every_lint_left_has_a_reason():
    printed = forked.snakemake(
        "--snakefile", ROOT / "Snakefile", "--lint", cwd=ROOT, env=environment()
    ).printed
    lints = set(re.findall(r"^ +\* (.*):$", printed, re.MULTILINE))
    reasons = " ".join((ROOT / "CONTRIBUTING.md").read_text().split())
    assert lints and [lint for lint in lints if lint not in reasons] == []
