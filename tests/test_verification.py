"""`brownpipe verify`: every damaged, missing or exchanged file is named, with the command that makes it again."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import forked
from brownpipe.cli import main
from brownpipe.errors import DONE, FAILED, WRONG_REQUEST, StorageError
from brownpipe.storage import read_dataset, write_dataset
from brownpipe.storage.checksums import read_checksums, write_checksums, write_sealed_text
from brownpipe.study import read_study, run_count
from brownpipe.study.expectation import expected_files, read_settled
from brownpipe.study.run_record import RunRecord, write_run_record
from brownpipe.study.verification import Verdict, verify_file, verify_results

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
RESULTS = Path("results/mine")
SHOWN = {f"figures/health.{kind}" for kind in ("csv", "png", "svg")}
SHOWN |= {f"figures/{name}" for name in ("summary.csv", "summary.txt", "provenance.json")} | {"report.html"}
FILES = {f"simulate/hot/N6/exact/{name}.h5" for name in ("0-1", "2-3")} | SHOWN
REPLAYED = "replay/hot/N6/exact/0-0.h5"
FILES |= {REPLAYED, "aggregate/mine.nc", "figures/SHA256SUMS", "run.yaml"}


def make_results():
    """What the workflow makes, by the commands of its rules."""
    for path, request in expected_files(read_settled("mine.yaml")):
        seeds = f"{request.seeds[0]}-{request.seeds[-1]}"
        assert main(["simulate", "hot.yaml", "--particles", "6", "--seeds", seeds, "--output", path]) == DONE
    dataset = f"{RESULTS}/aggregate/mine.nc"
    assert main(["aggregate", "--study", "mine.yaml", "--output", dataset]) == DONE
    replayed = ["--seeds", "0", "--record", "all,events", "--output", f"{RESULTS}/{REPLAYED}"]
    assert main(["simulate", "hot.yaml", "--particles", "6", *replayed]) == DONE
    words = ["--figures", "health", "--page", f"{RESULTS}/report.html", "--replay", replayed[-1]]
    assert main(["figures", dataset, "--output", f"{RESULTS}/figures", *words]) == DONE
    write_run_record(RESULTS, RunRecord("mine.yaml"))


def finished(folder, mass):
    """A folder with a finished study of a bath of this mass."""
    (folder / "hot.yaml").write_text(SCENE.replace("0.4}", f"{mass}}}"))
    (folder / "mine.yaml").write_text("scenes: hot.yaml\nseeds: 4\nbatch: 2\nfigures: [health]\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        make_results()
    return folder


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("verified"), 0.4)


@pytest.fixture(scope="module")
def heavier(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("heavier"), 0.5)


@pytest.fixture
def study(original, tmp_path, monkeypatch):
    """A copy of the original, which is the working directory."""
    folder = shutil.copytree(original, tmp_path / "copy")
    monkeypatch.chdir(folder)
    return folder


@pytest.fixture
def studies(study, heavier):
    """The same, and in its folder `other` the same study of a heavier bath."""
    shutil.copytree(heavier, study / "other")
    return study


def contents(folder=RESULTS):
    return {file: (folder / file).read_bytes() for file in FILES}


def flip(path, chance):
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def cut(path, chance):
    os.truncate(path, chance.randrange(path.stat().st_size))


def append(path, chance):
    with open(path, "ab") as file:
        file.write(chance.randbytes(chance.choice([1, 7, 4096])))


def remove(path, chance):
    path.unlink()


def take_from_other(path, chance):
    shutil.copy(Path("other") / path, path)


DAMAGES = (flip, cut, append, remove, take_from_other)


def harm(chance):
    """Do one random harm to the results; return the files that are then wrong."""
    before = contents()
    if chance.random() < 0.2:
        one, other = (RESULTS / file for file in chance.sample(sorted(FILES), 2))
        (before_one, before_other) = one.read_bytes(), other.read_bytes()
        one.write_bytes(before_other), other.write_bytes(before_one)
    else:
        chance.choice(DAMAGES)(RESULTS / chance.choice(sorted(FILES)), chance)
    now = {file: (RESULTS / file).read_bytes() if (RESULTS / file).exists() else None for file in FILES}
    return {file for file in FILES if now[file] != before[file]}


def named(verdict):
    return {file for file, _ in verdict.problems}


@pytest.mark.slow
@pytest.mark.promise(
    "a byte of a result changes, a file is cut, replaced or deleted, two files change places",
    "`brownpipe verify` names exactly the files concerned, and the command it prints makes them again, byte for byte.",
)
def test_any_damage_is_found_and_nothing_else(studies, faults):
    """SHA256SUMS is the exception: without it damage to a figure cannot be seen, and all are made again."""
    before = contents()
    assert verify_results(RESULTS) == Verdict(len(FILES), (), (), None)
    for _ in faults.tries(8):
        wrong = harm(faults.random)
        found = named(verify_results(RESULTS))
        hidden = SHOWN if "figures/SHA256SUMS" in wrong else set()
        assert found - hidden == wrong - hidden, faults.seed
        for file in wrong:
            (RESULTS / file).write_bytes(before[file])
    assert verify_results(RESULTS).problems == ()


@pytest.mark.slow
def test_the_command_that_is_printed_makes_again_what_was_wrong(studies, faults, capsys):
    before = contents()
    surroundings = os.environ | {"PATH": f"{forked.programs()}:{Path(sys.executable).parent}:{os.environ['PATH']}"}
    for _ in faults.tries(1):
        while not harm(faults.random):
            pass
        capsys.readouterr()
        assert main(["verify", str(RESULTS)]) == FAILED
        cure = capsys.readouterr().out.splitlines()[-1]
        done = subprocess.run(["bash", "-c", cure], env=surroundings, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, (faults.seed, cure, done.stdout, done.stderr)
        assert main(["verify", str(RESULTS)]) == DONE
        assert [file for file, data in contents().items() if data != before[file]] == [], cure


@pytest.mark.slow
def test_what_is_wrong_is_said_with_its_cure(study, capsys):
    (RESULTS / "figures/health.png").unlink()
    with open(RESULTS / "simulate/hot/N6/exact/0-1.h5", "ab") as file:
        file.write(b"x")
    capsys.readouterr()
    assert main(["verify", str(RESULTS)]) == FAILED
    assert capsys.readouterr().out.splitlines() == [
        "results/mine/figures/health.png: is missing",
        "results/mine/simulate/hot/N6/exact/0-1.h5: was damaged or edited after it was written",
        "results/mine: 11 files intact, 2 not; to make these again:",
        "rm -rf -- results/mine/simulate/hot/N6/exact/0-1.h5 && brownpipe run mine.yaml",
    ]


def test_keys_that_the_command_line_replaced_are_part_of_the_cure(study):
    write_run_record(RESULTS, RunRecord("mine.yaml", {"seeds": "0-1", "particles": [6]}))
    verdict = verify_results(RESULTS)
    assert named(verdict) == {"aggregate/mine.nc"}
    assert verdict.cure.endswith(" && brownpipe run mine.yaml -- --config 'seeds=\"0-1\"' 'particles=[6]'")
    assert verdict.remarks == ("intact, but not of the study as it is now: simulate/hot/N6/exact/2-3.h5",)


@pytest.mark.promise(
    "files of others, or of another version of brownpipe, are among the results",
    "`brownpipe verify` names them and leaves them alone; they are no fault.",
)
def test_foreign_files_and_those_of_another_version_are_only_named(study, monkeypatch):
    (RESULTS / "notes.txt").write_text("mine")
    (RESULTS / "simulate" / "old.h5").write_text("text")
    os.mkfifo(RESULTS / "figures" / "pipe.png")
    monkeypatch.setattr("brownpipe.study.verification.source_digest", lambda *_: "another")
    verdict = verify_results(RESULTS)
    assert verdict.problems == () and verdict.intact == len(FILES)
    foreign, older = verdict.remarks
    assert foreign == "not made by the study, and not verified: figures/pipe.png, notes.txt, simulate/old.h5"
    assert older.startswith(f"intact, but made by another version of brownpipe: {REPLAYED}, simulate/hot/N6/exact/")


def test_without_a_record_the_study_of_that_name_is_taken(study):
    (RESULTS / "run.yaml").unlink()
    assert verify_results(RESULTS).cure == "brownpipe run mine.yaml"
    Path("mine.yaml").unlink()
    (RESULTS / "simulate/hot/N6/exact/0-1.h5").rename(RESULTS / "simulate/hot/N6/exact/2-3.h5")
    verdict = verify_results(RESULTS)
    assert dict(verdict.problems)["simulate/hot/N6/exact/2-3.h5"] == "holds the runs of simulate/hot/N6/exact/0-1.h5"
    nothing = "run.yaml: cannot be read: No such file or directory, and there is no study file mine.yaml"
    assert verdict.unknown == f"results/mine/{nothing}"
    assert verdict.cure is None, "nothing is to be deleted that no known command makes again"


def rename(study):
    (study / "mine.yaml").rename(study / "renamed.yaml")
    return "results/mine", "mine.yaml: cannot be read: No such file or directory"


def spoil(study):
    (study / "mine.yaml").write_text(f"{(study / 'mine.yaml').read_text()}bogus: 1\n")
    return "results/mine", "mine.yaml: line 5: unknown key 'bogus'"


def copy_elsewhere(study):
    shutil.copytree(study / "results", study / "backup/kept/results")
    return "backup/kept/results/mine", "backup/kept/mine.yaml: cannot be read: No such file or directory"


@pytest.mark.parametrize("lose", [rename, spoil, copy_elsewhere])
def test_without_its_study_results_are_not_called_complete(study, lose, capsys):
    folder, why = lose(study)
    (study / folder / "simulate/hot/N6/exact/2-3.h5").unlink()
    assert main(["verify", folder]) == FAILED
    unknown, count = capsys.readouterr().out.splitlines()
    assert unknown.startswith(f"{folder}: completeness was not checked: {why}")
    assert count == f"{folder}: 12 files intact"
    for file in ("figures/health.png", "report.html", "aggregate/mine.nc"):
        (study / folder / file).unlink()
    assert main(["verify", folder]) == FAILED
    *missing, unknown, count = capsys.readouterr().out.splitlines()
    files = ("aggregate/mine.nc", "figures/health.png", "report.html")
    assert missing == [f"{folder}/{file}: is missing" for file in files]
    assert count == f"{folder}: 9 files intact, 3 not"


@pytest.mark.parametrize("place", ["results/other", "old/mine"])
def test_no_command_is_printed_for_results_in_another_place(study, place, capsys):
    Path("old").mkdir()
    RESULTS.rename(place)
    (Path(place) / "figures/health.png").write_text("edited")
    assert main(["verify", place]) == FAILED
    assert capsys.readouterr().out.splitlines() == [
        f"{place}/figures/health.png: was damaged or edited after it was written",
        f"{place}: is not named results/mine, after its study: brownpipe run mine.yaml makes files again only there",
        f"{place}: 12 files intact, 1 not",
    ]


def test_the_plan_is_that_in_the_folder_also_if_that_was_renamed(study):
    """Four runs, which no tolerance of this scene needs."""
    Path("mine.yaml").write_text("scenes: hot.yaml\ntolerance: 20 %\ntarget: displacement_distribution\nbatch: 2\n")
    plan = RESULTS / "plan.yaml"
    needed = len(run_count.settle(read_study("mine.yaml"), plan, print).seeds)
    plan.write_text(plan.read_text().replace(f": {needed}", ": 4"))
    RESULTS.rename("results/other")
    assert not any(file.startswith("simulate/") for file, _ in verify_results("results/other").problems)


def test_a_study_that_was_renamed_with_its_results_is_found(study):
    Path("mine.yaml").rename("yours.yaml")
    RESULTS.rename("results/yours")
    verdict = verify_results("results/yours")
    assert verdict.problems == (("aggregate/yours.nc", "is missing"),)
    assert verdict.cure == "brownpipe run yours.yaml" and verdict.unknown is None


def test_from_another_folder_the_cure_goes_there_first(study, monkeypatch):
    (RESULTS / "figures/summary.txt").unlink()
    (study / "other").mkdir()
    monkeypatch.chdir(study / "other")
    assert verify_results(study / RESULTS).cure == f"cd {study} && brownpipe run mine.yaml"


@pytest.mark.parametrize(
    ("start", "path"), [("results", "mine"), ("results/mine", "."), ("results/mine/figures", "../../mine//")]
)
def test_a_relative_path_is_as_good_as_any_other(study, start, path, monkeypatch, capsys):
    (RESULTS / "simulate/hot/N6/exact/2-3.h5").unlink()
    (RESULTS / "figures/health.csv").write_text("edited")
    monkeypatch.chdir(start)
    assert main(["verify", path]) == FAILED
    *problems, count, cure = capsys.readouterr().out.splitlines()
    files = (
        "figures/health.csv: was damaged or edited after it was written",
        "simulate/hot/N6/exact/2-3.h5: is missing",
    )
    assert problems == [f"{Path(path) / file}" for file in files]
    assert count == f"{Path(path)}: 11 files intact, 2 not; to make these again:"
    assert cure == f"cd {study} && rm -rf -- results/mine/figures/health.csv && brownpipe run mine.yaml"


@pytest.mark.parametrize(
    ("file", "cure"),
    [
        (
            "simulate/hot/N6/exact/0-1.h5",
            "seeds 0-1 are lost: delete it and run the study again, or brownpipe simulate",
        ),
        ("aggregate/mine.nc", "delete it and run the study, brownpipe aggregate or brownpipe tradeoff again"),
        ("figures/health.svg", "brownpipe figures results/mine/aggregate/mine.nc --output results/mine/figures"),
        ("report.html", "delete it and run the study again"),
    ],
)
def test_a_single_file(study, capsys, file, cure):
    path = RESULTS / file
    assert main(["verify", str(path)]) == DONE
    assert capsys.readouterr().out == f"{path}: intact\n"
    with open(path, "ab") as stream:
        stream.write(b"x")
    assert main(["verify", str(path)]) == FAILED
    assert capsys.readouterr().err.startswith(f"brownpipe: {path}: was damaged or edited after it was written; {cure}")


def test_every_bad_file_of_several_is_named(study, capsys):
    sound, edited, cut_short = (RESULTS / file for file in ("aggregate/mine.nc", "report.html", REPLAYED))
    with open(edited, "a") as file:
        file.write("x")
    os.truncate(cut_short, 100)
    assert main(["verify", "absent.h5", *map(str, (edited, sound, cut_short)), "hot.yaml", str(RESULTS)]) == FAILED
    printed, said = capsys.readouterr()
    bad = ("absent.h5", edited, cut_short, "hot.yaml")
    assert [line.split(": ")[1] for line in said.splitlines()] == [*map(str, bad)]
    assert printed.startswith(f"{sound}: intact\n") and printed.count("\n") == 5
    assert main(["verify", "absent.h5", str(sound)]) == WRONG_REQUEST


@pytest.mark.parametrize("path", ["absent", "hot.yaml", "."])
def test_what_brownpipe_did_not_make_is_no_result(study, path, capsys):
    assert main(["verify", path]) == WRONG_REQUEST


def test_all_studies_of_a_folder_are_verified(study, capsys):
    shutil.copytree(RESULTS, "results/tradeoff")
    Path("results/notes").mkdir()
    (RESULTS / "figures/health.png").unlink()
    assert main(["verify", "results/"]) == FAILED
    lines = capsys.readouterr().out.splitlines()
    assert lines[:3] == [
        "results/mine/figures/health.png: is missing",
        "results/mine: 12 files intact, 1 not; to make these again:",
        "brownpipe run mine.yaml",
    ]
    counted = [line.partition(": ")[0] for line in lines if " files intact" in line]
    assert counted == ["results/mine", "results/tradeoff"]


def test_a_study_of_that_name_elsewhere_is_not_taken_for_the_one_in_the_record(study, capsys):
    """Intact results would be called those of other runs, and the command that is printed would delete them."""
    Path("archive").mkdir()
    Path("old").mkdir()
    shutil.move("mine.yaml", "archive/mine.yaml")
    Path("old/mine.yaml").write_text(Path("archive/mine.yaml").read_text().replace("seeds: 4", "seeds: 8"))
    assert main(["verify", str(RESULTS)]) == FAILED
    out = capsys.readouterr().out
    assert "completeness was not checked: mine.yaml: " in out and "rm -rf" not in out and "holds" not in out


def test_two_dots_behind_a_link_lead_where_the_system_has_them(study, capsys):
    Path("elsewhere/results/z").mkdir(parents=True)
    shutil.copytree(RESULTS, "elsewhere/results/mine")
    Path("elsewhere/results/mine/figures/health.png").unlink()
    Path("results/link").symlink_to(Path("elsewhere/results/z").absolute())
    assert main(["verify", "results/link/../mine"]) == FAILED
    assert "figures/health.png: is missing" in capsys.readouterr().out


PART = "is a part of results/mine, which can only be verified as a whole"
OTHER = "is not the folder of a study's results (results/STUDY); single trajectory files, datasets, figures and tables"


@pytest.mark.parametrize(
    ("folder", "why"),
    [("results/mine/simulate", PART), ("results/mine/figures//", PART), ("drawn", OTHER), (".", OTHER)],
)
def test_a_folder_that_is_not_that_of_one_study_is_refused(study, folder, why, capsys):
    shutil.copytree(RESULTS / "figures", "drawn")
    shutil.copy("mine.yaml", "run.yaml")  # the name of the record of a study
    assert main(["verify", folder]) == WRONG_REQUEST
    printed, said = capsys.readouterr()
    assert printed == "" and said.startswith(f"brownpipe: {Path(folder)}: {why}") and said.count("\n") == 1


@pytest.mark.parametrize(("file", "name"), [("aggregate/mine.nc", "noext"), (REPLAYED, "traj.nc")])
def test_the_name_of_a_file_does_not_decide_whether_it_is_intact(study, file, name, capsys):
    shutil.copy(RESULTS / file, name)
    assert main(["verify", name]) == DONE
    with open(name, "ab") as stream:
        stream.write(b"x")
    assert main(["verify", name]) == FAILED


@pytest.mark.parametrize("verb", ["inspect", "verify"])
def test_texts_and_logs_are_not_called_damaged(study, verb, capsys):
    Path("logs").mkdir()
    logs = [Path("logs/empty.log"), Path("logs/long.log")]
    for log, text in zip(logs, ("", "brownpipe: compiling\n"), strict=True):
        log.write_text(text)
    readable = "trajectory files, datasets, figures and tables can be inspected and verified"
    sealed = f"is text that is verified with its study, by brownpipe verify results/STUDY; {readable} alone"
    kinds = dict.fromkeys(logs, f"is a log; {readable}")
    kinds |= {RESULTS / file: sealed for file in ("run.yaml", "figures/SHA256SUMS")}
    for path, kind in kinds.items():
        assert main([verb, str(path)]) == WRONG_REQUEST
        assert capsys.readouterr().err == f"brownpipe: {path}: {kind}\n"
    Path("empty.h5").touch()
    assert main([verb, "empty.h5"]) == FAILED


def test_a_product_alone_is_verified_where_it_was_made(study, tmp_path, capsys):
    for file in sorted(SHOWN):
        path = shutil.copy(RESULTS / file, tmp_path)
        assert main(["verify", path]) == WRONG_REQUEST
        said = f"brownpipe: {path}: must be verified where the study made it, as SHA256SUMS there lists it\n"
        assert capsys.readouterr().err == said


def test_sha256sum_reads_the_checksums(study):
    words = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    done = subprocess.run(words, cwd=RESULTS / "figures", capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stdout.count(": OK\n") == len(SHOWN) + 1, done.stderr


def test_any_name_is_listed_as_sha256sum_does(tmp_path):
    names = ["a b.txt", "back\\slash\\n", "new\nline", "ü.png"]
    for name in names:
        (tmp_path / name).write_text(name)
    write_checksums(tmp_path, [tmp_path / name for name in names])
    assert read_checksums(tmp_path).keys() == {*names}
    words = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    assert subprocess.run(words, cwd=tmp_path, capture_output=True, timeout=60).returncode == 0


def test_checksums_of_files_outside_the_results_do_not_count(study):
    """The command that is printed would delete them."""
    listed = f"{'0' * 64}  ../../../mine.yaml\n{'0' * 64}  ../../absent\n{'0' * 64}  {Path('mine.yaml').absolute()}\n"
    write_sealed_text(RESULTS / "tradeoff" / "SHA256SUMS", listed)
    verdict = verify_results(RESULTS)
    assert not any(".." in file or "mine.yaml" in file for file, _ in verdict.problems)
    assert ".." not in (verdict.cure or "")


def test_a_trade_off_without_figures_lacks_nothing(study):
    """As brownpipe tradeoff makes it."""
    (RESULTS / "tradeoff").mkdir()
    shutil.copy(RESULTS / "aggregate" / "mine.nc", RESULTS / "tradeoff" / "mine.nc")
    assert {file for file, _ in verify_results(RESULTS).problems} == {"tradeoff/mine.nc"}  # no trade-off, but alone


def test_a_plan_that_contradicts_itself_is_not_used(tmp_path):
    path, plan = tmp_path / "plan.yaml", "needed:\n  hot, N = 6: 120\nruns: 120\n"
    for text in (plan, plan.replace("runs: 120", "runs: 12"), plan.replace("runs: 120\n", ""), "runs: 120\n", "- 3\n"):
        path.write_text(text)
        assert bool(run_count._stored_plan(path)) == (text == plan)


def pipe(path):
    os.mkfifo(path)


def link_to_nothing(path):
    path.symlink_to("nothing")


@pytest.mark.promise(
    "a pipe, folder or broken link in place of a result", "`brownpipe verify` names it and never waits."
)
@pytest.mark.parametrize(
    "plant",
    [pipe, pytest.param(Path.mkdir, marks=pytest.mark.slow), pytest.param(link_to_nothing, marks=pytest.mark.slow)],
    ids=["pipe", "folder", "link"],
)
@pytest.mark.parametrize("file", sorted(FILES - SHOWN | {"figures/health.csv"}))
def test_what_is_no_file_is_named(study, file, plant):
    def too_long(*_):
        raise TimeoutError

    path = RESULTS / file
    path.unlink()
    plant(path)
    before = signal.signal(signal.SIGALRM, too_long)
    signal.alarm(30)
    try:
        assert file in named(verify_results(RESULTS))
        with pytest.raises(StorageError):
            verify_file(path)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize(
    "name", ["run_status", "runs", "failed_runs", "scene", "particles", "engine", "seed", "window"]
)
def test_a_sealed_dataset_that_lacks_a_part_is_named(study, name):
    path = RESULTS / "aggregate/mine.nc"
    dataset = read_dataset(path)
    missing = f"{name}: is missing in the dataset; make it again"
    write_dataset(path, dataset.drop_vars(name))
    assert dict(verify_results(RESULTS).problems)["aggregate/mine.nc"] == missing
    if name in dataset.dims:
        write_dataset(path, dataset.isel({name: 0}))
        others = ("is of other runs than those of the study", "has other fit windows than the study")
        assert dict(verify_results(RESULTS).problems)["aggregate/mine.nc"] in (missing, *others)


@pytest.mark.promise("a list of checksums is exchanged", "It is named, also if what replaces it is sealed.")
def test_a_sealed_text_that_is_no_list_of_checksums_is_named(study):
    shutil.copy(RESULTS / "run.yaml", RESULTS / "figures/SHA256SUMS")
    assert "figures/SHA256SUMS" in named(verify_results(RESULTS))
