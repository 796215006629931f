"""`brownpipe new` and `brownpipe run`: a study in any folder. (That the workflow itself is right: test_workflow.)"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from brownpipe import provenance
from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST
from brownpipe.study import changes, read_study, workflow

ROOT = Path(__file__).parent.parent


pytestmark = pytest.mark.usefixtures("elsewhere")


@pytest.fixture
def started(monkeypatch):
    """The commands and environments that would have been run, in place of Snakemake."""
    calls = []
    monkeypatch.setattr(workflow, "_wait_for", lambda command, environment: calls.append((command, environment)) or 0)
    return calls


def said(capsys, *words):
    """Exit status, standard output, and standard error."""
    try:
        status = main([*words])
    except SystemExit as left:
        status = left.code
    return status, *capsys.readouterr()


# -- new ------------------------------------------------------------------------------------------------------------


def test_new_writes_a_scene_and_a_study_that_are_valid_and_names_the_next_commands(capsys, started):
    status, out, err = said(capsys, "new", "first", "--folder", "my studies")
    assert (status, err) == (DONE, "")
    assert sorted(path.name for path in Path("my studies").iterdir()) == ["first.yaml", "first_scene.yaml"]
    next_commands = [shlex.split(line, comments=True) for line in out.splitlines() if line.startswith("brownpipe ")]
    assert [words[1] for words in next_commands] == ["check", "run"]
    described = [said(capsys, *words[1:]) for words in next_commands]
    assert [status for status, _, _ in described] == [DONE, DONE] and len(started) == 1
    seconds = re.search(r"^total     600 runs in 2 jobs .* some ([0-9.]+) s of CPU", described[0][1], re.MULTILINE)
    assert float(seconds[1]) < 15  # a wall time below 30 s on two cores, with kernels to compile
    assert said(capsys, "check", "my studies/first_scene.yaml")[0] == DONE
    readme = out.rpartition("all keys: ")[2].strip()
    assert Path(readme) == ROOT / "config" / "README.md" and Path(readme).is_file()


def test_every_key_that_the_templates_only_mention_may_be_given(capsys):
    assert main(["new", "first"]) == DONE
    for path in (Path("first.yaml"), Path("first_scene.yaml")):
        text, count = re.subn(r"^( *)# (position|observables|figures):", r"\1\2:", path.read_text(), flags=re.MULTILINE)
        assert count == {"first.yaml": 2, "first_scene.yaml": 1}[path.name]
        path.write_text(text)
    assert said(capsys, "check", "first.yaml")[0] == DONE
    text, count = re.subn("^seeds:.*\n# tolerance:", "tolerance:", Path("first.yaml").read_text(), flags=re.MULTILINE)
    Path("first.yaml").write_text(text)
    assert count == 1 and said(capsys, "check", "first.yaml")[0] == DONE


@pytest.mark.parametrize("there", ["first.yaml", "first_scene.yaml"])
def test_new_replaces_no_file(capsys, there):
    Path(there).symlink_to("nowhere")
    status, out, err = said(capsys, "new", "first.yaml")
    assert (status, out, err) == (WRONG_REQUEST, "", f"brownpipe: {there}: exists; choose another name or folder\n")
    assert [path.name for path in Path().iterdir()] == [there]


@pytest.mark.parametrize("name", ["a b", "../a", "", "-" * 3 + "a", "a" * 60])
def test_new_refuses_what_is_no_name(capsys, name):
    status, out, err = said(capsys, "new", "--", name)
    assert (status, out) == (WRONG_REQUEST, "")
    assert re.fullmatch(r"brownpipe: (NAME|name of the scene): must be a name: .*, not '.*'\n", err)
    assert not list(Path().iterdir())


def test_new_leaves_nothing_where_the_second_file_cannot_be_written(capsys, monkeypatch):
    replace = os.replace

    def fail(old, new):
        if Path(new).name == "first.yaml":
            raise OSError(28, "No space left on device")
        replace(old, new)

    monkeypatch.setattr(os, "replace", fail)
    status, _, err = said(capsys, "new", "first")
    assert status == FAILED and err.startswith("brownpipe: first.yaml: not written: ") and err.count("\n") == 1
    assert not list(Path().iterdir())


# -- run ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def study(capsys):
    assert main(["new", "first", "--folder", "my studies"]) == DONE
    capsys.readouterr()
    return "my studies/first.yaml"


def test_run_starts_the_workflow_of_this_installation(capsys, study, started, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    assert said(capsys, "run", study, "-j", "3", "--", "tradeoff_figures", "--config", "seeds=3") == (DONE, "", "")
    ((command, environment),) = started
    further = ["tradeoff_figures", "--config", "seeds=3"]
    first = [
        sys.executable,
        "-P",
        "-c",
        workflow.SNAKEMAKE,
        "--snakefile",
        str(ROOT / "Snakefile"),
        "--configfile",
        study,
    ]
    assert (command[: len(first)], command[-5:]) == (first, ["--cores", "3", *further])
    profile = yaml.safe_load((ROOT / "profiles" / "default" / "config.yaml").read_text())
    options = [f"--{key}" if value is True else f"--{key} {value}" for key, value in profile.items()]
    assert " ".join(command[len(first) : -5]) == " ".join(["--workflow-profile none", *options])
    own, _, rest = environment["PATH"].partition(":")
    assert rest == "/nowhere" and os.access(f"{own}/brownpipe", os.X_OK)
    unlock = [f"{own}/brownpipe", "run", study, "--", "--unlock"]  # not in the PATH of the caller
    assert shlex.split(environment["UNLOCK_COMMAND"]) == unlock


def test_run_by_default_uses_all_cores_and_names_itself_as_it_was_called(capsys, study, started, monkeypatch):
    own = workflow._own_command()
    monkeypatch.setenv("PATH", str(own.parent))
    assert said(capsys, "run", study) == (DONE, "", "")
    ((command, environment),) = started
    assert command[-2:] == ["--cores", "all"]
    assert environment["UNLOCK_COMMAND"] == "brownpipe run 'my studies/first.yaml' -- --unlock"
    assert said(capsys, "run", study, "-n", "--", "--printshellcmds") == (DONE, "", "")
    assert started[1][0] == [*command, "--printshellcmds", "--dry-run"]


@pytest.mark.slow
def test_the_report_is_written_after_a_run_that_succeeds(capsys, study, started, monkeypatch):
    assert said(capsys, "run", study, "--report", "page.zip")[0] == DONE
    (run, _), (report, _) = started
    assert report == [*run, "--report", "page.zip"]
    monkeypatch.setattr(workflow, "_wait_for", lambda command, _: 1 if "--report" not in command else 0)
    assert said(capsys, "run", study, "--report")[0] == 1


@pytest.mark.promise("runs of a study fail", "The report is written nevertheless; the exit status stays 1.")
@pytest.mark.parametrize(("missing", "reports"), [({}, 1), ({"simulate": "1"}, 0)])
def test_the_report_is_written_if_all_results_are_there(capsys, study, monkeypatch, missing, reports):
    calls = []
    monkeypatch.setattr(workflow, "_planned", lambda *_: missing)
    monkeypatch.setattr(workflow, "_wait_for", lambda words, _: calls.append(words) or int("--report" not in words))
    assert said(capsys, "run", study, "--report")[0] == FAILED
    assert sum("--report" in words for words in calls) == reports


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["absent.yaml"], "absent.yaml: cannot be read: No such file or directory"),
        (["my studies/first_scene.yaml"], "my studies/first_scene.yaml: .*"),
        (["my studies/first.yaml", "--report", "page.pdf"], "--report page.pdf: must end in .html or .zip"),
        (["my studies/first.yaml", "--report", "absent/page.html"], "--report absent/page.html: its folder is .*"),
        (["my studies/first.yaml", "-n", "--report"], "--report report.html: must not be given with -n, .*"),
    ],
)
def test_run_refuses_at_once(capsys, study, started, words, message):
    status, out, err = said(capsys, "run", *words)
    assert (status, out, started) == (WRONG_REQUEST, "", [])
    assert re.fullmatch(f"brownpipe: {message}\n", err)


def test_a_study_that_needs_the_keys_passed_on_is_left_to_snakemake(capsys, study, started):
    Path(study).write_text("scenes: first_scene.yaml\n")
    assert said(capsys, "run", study)[0] == WRONG_REQUEST and not started
    assert said(capsys, "run", study, "--", "--config", "seeds=3")[0] == DONE and len(started) == 1


@pytest.mark.parametrize("locked", [".", "results", ".snakemake"])
def test_a_folder_that_cannot_be_written_to(capsys, study, started, monkeypatch, locked):
    """Asked of os.access: to root, who may run the tests, every folder is writable."""
    Path("results").mkdir()
    Path(".snakemake").mkdir()
    monkeypatch.setattr(os, "access", lambda path, mode: path != locked)
    where = Path.cwd() if locked == "." else locked
    line = f"brownpipe: {where}: cannot be written to; run the study from another folder\n"
    assert said(capsys, "run", study) == (FAILED, "", line) and not started


def test_an_installed_pipeline_comes_before_a_checkout(monkeypatch, tmp_path):
    assert workflow.pipeline_folder() == ROOT
    (tmp_path / "pipeline").mkdir()
    monkeypatch.setattr(workflow, "PACKAGE", tmp_path)
    assert workflow.pipeline_folder() == tmp_path / "pipeline"


# -- what has changed -----------------------------------------------------------------------------------------------


@pytest.fixture
def simulated():
    """A study of one scene in two jobs, the trajectory files of both, and a function that gives the differences."""
    shutil.copy(ROOT / "config" / "scenes" / "harrison2020.yaml", "hot.yaml")
    Path("mine.yaml").write_text("scenes: hot.yaml\nparticles: [10]\nseeds: 4\nbatch: 2\n")
    for job in read_study("mine.yaml").jobs():
        output = f"results/mine/simulate/{job.file}"
        seeds = f"{job.first}-{job.last}"
        assert main(["simulate", "hot.yaml", "--particles", "10", "--seeds", seeds, "--output", output]) == DONE
    return lambda: changes.changes(read_study("mine.yaml"))


def edit(file, *replacements):
    text = Path(file).read_text()
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    Path(file).write_text(text)


@pytest.mark.slow
def test_what_differs_from_the_results_is_said_in_words(simulated, capsys, started):
    assert simulated() == []
    respelled = ("position: [0.0, 0.0]", "position: [0, 0]")
    edit("hot.yaml", ("mass: 0.4", "mass: 0.5"), ("x: [-3.0, 3.0]", "x: [-3, 4]"), respelled)
    scene = ["scene hot: box.x [-3.0, 3.0] -> [-3.0, 4.0]", "scene hot: disks.species[0].mass 0.4 -> 0.5"]
    assert simulated() == scene
    edit("mine.yaml", ("seeds: 4", "seeds: 8"), ("[10]", "[10, 12]"))
    lines = [*scene, "seeds 4 -> 8 (hot N10 exact)", "no runs yet (hot N12 exact)"]
    assert simulated() == lines
    status, out, _ = said(capsys, "run", "mine.yaml", "-n")
    jobs = "to run: replay 1, simulate 6, aggregate 1, figures 1\n"
    assert (status, out) == (DONE, jobs + "".join(f"differs from results/mine: {line}\n" for line in lines))


def test_the_oldest_file_of_a_case_counts(simulated):
    """An interrupted study has already made some files again."""
    edit("hot.yaml", ("duration: 1.0", "duration: 2.0"))
    output = "results/mine/simulate/hot/N10/exact/0-1.h5"
    assert main(["simulate", "hot.yaml", "--particles", "10", "--seeds", "0-1", "--output", output]) == DONE
    assert simulated() == ["scene hot: duration 1.0 -> 2.0"]


def test_other_batches_versions_and_sources_are_named(simulated, monkeypatch):
    edit("mine.yaml", ("seeds: 4\nbatch: 2", "seeds: [0-1, 3]\nbatch: 2"))
    assert simulated() == ["batch: the same seeds in other jobs"]
    monkeypatch.setattr(changes, "versions", lambda: provenance.versions() | {"numba_version": "99"})
    monkeypatch.setattr(changes, "source_digest", lambda *_: "another")
    numba = provenance.versions()["numba_version"]
    assert simulated()[:2] == ["engine exact: its source code", f"engine exact: numba {numba} -> 99"]


def test_what_is_recorded_and_measured_is_compared(simulated):
    edit("mine.yaml", ("seeds: 4", "observables: [square_displacement]\nrecord: none\nseeds: 4"))
    assert simulated() == ["record [tracer] -> []", "observables [] -> [square_displacement]"]


def test_ten_million_seeds_are_compared_by_their_ranges(study, monkeypatch):
    """Overlapping files of old divisions count each seed once, and no seed is listed: that took 1.2 GB."""
    folder = Path("results/first/simulate/first_scene/N200/exact")
    folder.mkdir(parents=True)
    for name in ("0-3999999", "2000000-4999999", "7-7", "12000000-12000009"):
        (folder / f"{name}.h5").touch()
    monkeypatch.setattr(changes, "_in_files", lambda *_: [])
    found = changes.changes(read_study(study, {"seeds": 10**7, "particles": 200}))
    assert found == [
        "seeds: 5000000 of 10000000 have been run; 5000000 of them again, in other jobs (not with the key batch: N)"
    ]


def test_a_study_without_results_differs_in_nothing(study):
    assert changes.changes(read_study(study)) == []


# -- the process of Snakemake ---------------------------------------------------------------------------------------

WAITS = "import signal, sys, time; signal.signal(signal.{}, lambda *_: sys.exit(7)); print('on', flush=True); {}"
PARENT = "import os, sys; from brownpipe import cli; from brownpipe.study import workflow;"
PARENT += (
    " workflow.snakemake_command = lambda *_, **__: [sys.executable, '-c', {!r}]; sys.exit(cli.main(['run', {!r}]))"
)


@pytest.mark.parametrize(("code", "status"), [("raise SystemExit(3)", 3), ("import os; os.kill(os.getpid(), 9)", 137)])
def test_the_exit_status_is_that_of_snakemake(capsys, study, monkeypatch, code, status):
    monkeypatch.setattr(workflow, "snakemake_command", lambda *_, **__: [sys.executable, "-c", code])
    assert said(capsys, "run", study)[0] == status


def test_an_interrupt_before_snakemake_is_ready_is_one_line(capsys, study, tmp_path, monkeypatch):
    """A module in place of Snakemake's is interrupted while it is imported."""
    (tmp_path / "snakemake").mkdir()
    interrupted = "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(60)\n"
    (tmp_path / "snakemake" / "__init__.py").touch()
    (tmp_path / "snakemake" / "cli.py").write_text(interrupted)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    command = [sys.executable, "-P", "-c", workflow.SNAKEMAKE]
    process = subprocess.run(command, capture_output=True, text=True, timeout=30)
    assert (process.returncode, process.stdout, process.stderr) == (130, "", "")
    assert said(capsys, "run", study) == (130, "", "brownpipe: interrupted\n")


@pytest.mark.parametrize(("number", "whole_group", "status"), [("SIGINT", True, 7), ("SIGTERM", False, 143)])
def test_a_signal_ends_snakemake_first(study, number, whole_group, status):
    """Ctrl-C reaches both processes, and the status is that of Snakemake; SIGTERM is passed on."""
    code = WAITS.format(number, "time.sleep(60)")
    command = [sys.executable, "-c", PARENT.format(code, study)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
    try:
        assert process.stdout.readline() == b"on\n"
        began = time.monotonic()
        (os.killpg if whole_group else os.kill)(process.pid, getattr(signal, number))
        assert process.wait(30) == status and time.monotonic() - began < 30
        assert process.stdout.read() == b""  # at its end: the other process is gone, too
        assert b"Traceback" not in process.stderr.read()
    finally:
        process.kill()
        process.communicate()


# -- on a cluster ---------------------------------------------------------------------------------------------------


@pytest.fixture
def plugin(monkeypatch):
    """Snakemake's plugin for Slurm, as if it were installed. No runs are planned."""
    monkeypatch.setattr(workflow, "_planned", lambda *_: {})
    monkeypatch.setattr(workflow, "find_spec", lambda name: name if name == "snakemake_executor_plugin_slurm" else None)


def test_a_profile_says_where_jobs_run_and_how_many(capsys, study, started, plugin):
    Path("my profile").mkdir()
    Path("my profile/config.yaml").write_text("executor: slurm\n")
    for name, folder in (("slurm", ROOT / "profiles" / "slurm"), ("my profile", Path("my profile").absolute())):
        assert said(capsys, "run", study, "--profile", name) == (DONE, "", "")
        assert started[-1][0][-2:] == ["--profile", str(folder)]
    assert said(capsys, "run", study, "--profile", "slurm", "-j", "9") == (DONE, "", "")
    assert started[-1][0][-2:] == ["--jobs", "9"]
    assert "--cores" not in started[-1][0]


def test_on_a_cluster_the_kernels_are_compiled_before_the_first_runs(capsys, study, started, plugin, monkeypatch):
    words = ["run", study, "--profile", "slurm", "--", "--config", "seeds=3"]
    assert said(capsys, *words) == (DONE, "", "") and len(started) == 1
    monkeypatch.setattr(workflow, "_planned", lambda *_: {"simulate": "6"})
    assert said(capsys, *words) == (DONE, "", "")
    (first, _), (then, _) = started[1:]
    assert first[-5:] == ["compile", "--config", "seeds=3", "--until", "compile"]
    assert then == started[0][0]
    assert said(capsys, "run", study) == (DONE, "", "") and len(started) == 4
    monkeypatch.setattr(workflow, "_wait_for", lambda command, _: started.append(command) or 7)
    assert said(capsys, *words) == (7, "", "") and len(started) == 5, "what cannot be compiled is not run"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("slrum", "--profile slrum: must be a folder with config.yaml, or one of slurm"),
        ("other", "--profile other: there is no snakemake-executor-plugin-my-queue here; install it by pip"),
        ("empty", "empty/config.yaml: empty; must be a mapping of keys to values"),
    ],
)
def test_a_profile_that_cannot_be_used(capsys, study, started, plugin, name, message):
    for folder, text in (("other", "executor: my-queue\n"), ("empty", "")):
        Path(folder).mkdir()
        Path(folder, "config.yaml").write_text(text)
    for further in ([], ["-n"]):
        status, out, err = said(capsys, "run", study, "--profile", name, *further)
        assert (status, out, started) == (WRONG_REQUEST, "", [])
        assert err.startswith("brownpipe: ") and err.endswith(f"{message}\n")


def test_a_path_that_the_jobs_of_a_cluster_could_not_read(capsys, study, started, plugin, monkeypatch):
    """Snakemake puts paths into the commands of remote jobs between apostrophes."""
    Path("newton's").mkdir()
    monkeypatch.chdir("newton's")
    status, out, err = said(capsys, "run", f"../{study}", "--profile", "slurm")
    assert (status, out, started) == (WRONG_REQUEST, "", [])
    assert re.fullmatch(r"brownpipe: --profile slurm: must not be given where a path has an apostrophe: .*\n", err)
    assert said(capsys, "run", f"../{study}") == (DONE, "", "")
