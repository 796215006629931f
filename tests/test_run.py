"""`brownpipe new` and `brownpipe run`: a study in any folder. (That the workflow itself is right:
test_workflow.)
"""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.engines import forecast
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST
from brownpipe.study import read_study, workflow
from brownpipe.study.run_sets import job_resources, run_sets

ROOT = Path(__file__).parent.parent
CONFIG = ROOT / "config"
pytestmark = pytest.mark.usefixtures("elsewhere")


@pytest.fixture
def started(monkeypatch):
    """The commands and environments that the process would have become, in place of Snakemake."""
    calls = []

    def execve(_, command, environment):
        calls.append((command, environment))
        sys.exit(DONE)

    monkeypatch.setattr(os, "execve", execve)
    return calls


# -- new -------------------------------------------------------------------------------------------


def test_new_writes_a_scene_and_a_study_that_are_valid_and_names_the_next_commands(said, started):
    status, out, err = said("new", "first", "--folder", "my studies")
    assert (status, err) == (DONE, "")
    assert sorted(path.name for path in Path("my studies").iterdir()) == [
        "first.yaml",
        "first_scene.yaml",
    ]
    next_commands = [
        shlex.split(line, comments=True)
        for line in out.splitlines()
        if line.startswith("brownpipe ")
    ]
    assert [words[1] for words in next_commands] == ["check", "run"]
    described = [said(*words[1:]) for words in next_commands]
    assert [status for status, _, _ in described] == [DONE, DONE] and len(started) == 1
    seconds = re.search(
        r"^total     600 runs in 2 jobs: some ([0-9.]+) s of CPU", described[0][1], re.MULTILINE
    )
    assert float(seconds[1]) < 15  # a wall time below 30 s on two cores, with kernels to compile
    assert said("check", "my studies/first_scene.yaml")[0] == DONE
    assert Path(out.rpartition("all keys: ")[2].strip()) == CONFIG / "README.md"


@pytest.mark.parametrize("there", ["first.yaml", "first_scene.yaml"])
@pytest.mark.parametrize("name", ["first", "a b", "../a", "", "---a", "a" * 60])
def test_new_replaces_no_file_and_refuses_what_is_no_name(said, name, there):
    Path(there).symlink_to("nowhere")
    status, out, err = said("new", "--", name)
    assert (status, out) == (WRONG_REQUEST, "") and err.count("\n") == 1
    assert (f"{there}: exists" if name == "first" else "must be a name: ") in err
    assert [path.name for path in Path().iterdir()] == [there]


@pytest.mark.parametrize("words", [["new", "second"], ["run", "absent.yaml"]])
def test_studies_need_snakemake(said, started, monkeypatch, words):
    monkeypatch.setattr(workflow, "find_spec", lambda name: None)
    line = "brownpipe: studies need Snakemake: pip install 'brownpipe[study]'\n"
    assert said(*words) == (WRONG_REQUEST, "", line)
    assert not started and list(Path().iterdir()) == []


# -- run -------------------------------------------------------------------------------------------


@pytest.fixture
def study(capsys):
    assert main(["new", "first", "--folder", "my studies"]) == DONE
    capsys.readouterr()
    return "my studies/first.yaml"


def test_run_starts_the_workflow_of_this_installation_and_passes_other_options_on(
    said, study, started, monkeypatch
):
    monkeypatch.setenv("PATH", "/nowhere")
    further = ["tradeoff_figures", "-n", "--config", "seeds=3"]
    assert said("run", study, "-j", "3", *further) == (DONE, "", "")
    ((command, environment),) = started
    assert command[1:4] == ["-P", "-c", workflow.PROGRAM]
    assert command[4:6] == [
        "--snakefile",
        str(ROOT / "Snakefile"),
    ]
    assert command[6:] == ["--configfile", study, "--cores", "3", *further]
    own, _, rest = environment["PATH"].partition(":")
    assert rest == "/nowhere" and os.access(f"{own}/brownpipe", os.X_OK)
    assert said("run", study) == (DONE, "", "")
    assert started[1][0][-2:] == ["--cores", "all"]


@pytest.mark.parametrize(
    ("folder", "works"),
    [
        *((name, False) for name in ("{7}", "runs {3rd}", "{ 12 }", "{b,(c}", "{²}/below")),
        *(
            (name, True)
            for name in ("{}", "{rule}", "{x}{x}", "{x,y}", "a{b", "x{{y}}", "{input[0]}", "{é}")
        ),
    ],
)
def test_folders_with_braces(said, study, started, monkeypatch, folder, works):
    """Snakemake takes some of them for wildcards, of whose names or patterns it makes no sense."""
    scene = shutil.copytree(Path(study).parent, Path(folder) / "studies")
    monkeypatch.chdir(folder)
    status, _, err = said("run", str(scene.relative_to(folder) / "first.yaml"))
    if works:
        assert (status, err) == (DONE, "") and len(started) == 1
        return
    assert status == WRONG_REQUEST and err.count("\n") == 1 and not started
    assert "Snakemake cannot run in a folder with such braces in its path" in err


def test_caches_are_kept_here_where_homes_cannot_be_written_to(said, study, started, monkeypatch):
    here = str(Path.cwd() / ".snakemake" / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(Path.cwd() / "mine"))
    said("run", study)
    assert started[-1][1]["XDG_CACHE_HOME"] == str(Path.cwd() / "mine")
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/1/no")
    said("run", study)
    assert started[-1][1]["XDG_CACHE_HOME"] == here
    monkeypatch.delenv("XDG_CACHE_HOME")
    for home in ("/dev/null", "/proc/nowhere/me"):
        monkeypatch.setenv("HOME", home)
        said("run", study)
        assert started[-1][1]["XDG_CACHE_HOME"] == here


def test_run_refuses_at_once(said, study, started, monkeypatch):
    line = "brownpipe: absent.yaml: cannot be read: No such file or directory\n"
    assert said("run", "absent.yaml") == (WRONG_REQUEST, "", line)
    line = f"brownpipe: {study}: must be the only study; --config KEY=VALUE replaces its keys\n"
    for other in (
        ["other.yaml"],
        ["-n", "--configfile", "other.yaml"],
        ["--configfile=other.yaml"],
    ):
        assert said("run", study, *other) == (WRONG_REQUEST, "", line)
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # to root every folder is writable
    line = f"brownpipe: {Path.cwd()}: cannot be written to; run the study from another folder\n"
    assert said("run", study) == (FAILED, "", line) and not started


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (
            "-n --seeds 10",
            "--seeds: is no option; --config seeds=VALUE replaces the key",
        ),
        ("--fit-windows=[[1,2]]", "--fit-windows: is no option; --config fit_windows=VALUE "),
        ("--config seeds", "--config: must be KEY=VALUE, like seeds=100, not 'seeds'"),
        ("-C seeds=3 seeds:4", "-C: must be KEY=VALUE, like seeds=100, not 'seeds:4'"),
    ],
)
def test_run_refuses_keys_of_the_study_in_a_wrong_place(said, study, started, words, reason):
    status, out, err = said("run", study, *words.split())
    assert (status, out) == (WRONG_REQUEST, "") and not started
    assert err.startswith(f"brownpipe: {reason}") and err.count("\n") == 1


@pytest.mark.parametrize("words", ["--batch all=1/2", "--config seeds=3 batch=2 -n", "-n results"])
def test_run_passes_on_the_options_of_snakemake(said, study, started, words):
    assert said("run", study, *words.split()) == (DONE, "", "")
    assert started[-1][0][-len(words.split()) :] == words.split()


def test_a_lock_of_a_study_that_runs_outlives_a_dry_run_that_began_before(monkeypatch):
    monkeypatch.setattr(workflow, "_held", [])
    workflow.remove_stale_locks()  # of the dry run
    workflow.remove_stale_locks()  # of the study
    lock = workflow.LOCKS / "0.output.lock"
    lock.touch()
    dry, running = workflow._held
    os.close(dry)
    workflow.remove_stale_locks()
    assert lock.exists()
    for process in (running, workflow._held[-1]):
        os.close(process)
    workflow.remove_stale_locks()
    assert not lock.exists()
    os.close(workflow._held[-1])


# -- on a cluster ----------------------------------------------------------------------------------


@pytest.fixture
def plugin(monkeypatch):
    """Snakemake and its plugin for Slurm, as if they were installed."""
    installed = {"snakemake", "snakemake_executor_plugin_slurm"}
    monkeypatch.setattr(workflow, "find_spec", lambda name: name in installed)


def test_a_profile_says_where_jobs_run_and_how_many(said, study, started, plugin):
    Path("my profile").mkdir()
    Path("my profile/config.yaml").write_text("executor: slurm\n")
    for name, folder in (
        ("slurm", ROOT / "profiles" / "slurm"),
        ("my profile", Path("my profile").absolute()),
    ):
        assert said("run", study, "--profile", name) == (DONE, "", "")
        assert started[-1][0][-2:] == ["--profile", str(folder)]
    assert said("run", study, "--profile", "slurm", "-j", "9") == (DONE, "", "")
    assert started[-1][0][-2:] == ["--jobs", "9"]
    assert "--cores" not in started[-1][0]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("slrum", "profiles/slrum/config.yaml: cannot be read: No such file or directory"),
        ("other", "--profile other: needs snakemake-executor-plugin-my-queue; install it by pip"),
        ("empty", "empty/config.yaml: empty; must be a mapping of keys to values"),
    ],
)
def test_a_profile_that_cannot_be_used(said, study, started, plugin, name, message):
    for folder, text in (("other", "executor: my-queue\n"), ("empty", "")):
        Path(folder).mkdir()
        Path(folder, "config.yaml").write_text(text)
    for further in ([], ["-n"]):
        status, out, err = said("run", study, "--profile", name, *further)
        assert (status, out, started) == (WRONG_REQUEST, "", [])
        assert err.startswith("brownpipe: ") and err.endswith(f"{message}\n")


def test_a_job_asks_for_twice_the_forecast_and_twice_as_much_at_each_retry():
    study = read_study(
        CONFIG / "small.yaml", {"particles": 50, "scenes": "scenes/harrison2020.yaml"}
    )
    asked, (runs,) = job_resources(study)["simulate"], run_sets(study)
    wildcards = {"digest": runs.key, "first": "0", "last": "999999"}
    cost = forecast.run_cost(study.cases[0])
    expected = forecast.memory(cost, 10**6) / 1e6
    assert 2 * expected < asked["mem_mb"](wildcards, attempt=1) < 2.2 * expected
    minutes = 10**6 * cost.seconds / 60
    assert 2 * minutes < asked["runtime"](wildcards, attempt=1) < 2 * minutes + 10
    for key in ("mem_mb", "runtime"):
        assert asked[key](wildcards, attempt=3) == 4 * asked[key](wildcards, attempt=1)
    assert asked["cpus_per_task"] == 1
    assert asked["mem_mb"](wildcards | {"last": "9"}, attempt=1) < 700
