"""Whether everything that a study has made is intact, and the command that makes the rest again: `brownpipe verify`.

Trajectory files, datasets, the plan and the record of the study have seals of their own. Figures, tables and texts are
compared with SHA256SUMS of their folder, in which the dataset that they show is listed, too. What a file contains is
compared with what the study asks for, so that exchanged files are found. One file at a time is in memory.
"""

import os
from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from brownpipe.analysis.displacement import labels
from brownpipe.analysis.variables import MISSING
from brownpipe.engines.request import Request
from brownpipe.errors import FigureError, RequestError, StorageError, WrongFileError
from brownpipe.figures.cases import cases_of, of_whole_dataset
from brownpipe.inspection import read_contents
from brownpipe.provenance import made_with, modules_of, source_digest
from brownpipe.quoting import printable, shell_path
from brownpipe.stages import tracked
from brownpipe.storage import Outline, read_dataset, read_trajectories
from brownpipe.storage.checksums import NAME as CHECKSUMS
from brownpipe.storage.checksums import digest_of, read_checksums, read_sealed_text
from brownpipe.storage.expected import difference
from brownpipe.study.expectation import expected_files, read_settled
from brownpipe.study.replay import replay_files
from brownpipe.study.run_count import PLAN, is_plan
from brownpipe.study.run_record import NAME as RECORD
from brownpipe.study.run_record import RunRecord, is_run_record, likely_study, read_run_record
from brownpipe.study.study import SimulationJob, Study
from brownpipe.tradeoff import is_tradeoff

if TYPE_CHECKING:
    from xarray import Dataset

NO_RESULTS = ("logs", "benchmarks")  # folders
PARTS = ("simulate", "aggregate", "figures", "tradeoff")  # folders, of which each study has one at least
MISSING_FILE = "is missing"
FOREIGN, SURPLUS, OLDER = "foreign", "surplus", "older"
REMARKS = {
    FOREIGN: "not made by the study, and not verified: {}",
    SURPLUS: "intact, but not of the study as it is now: {}",
    OLDER: "intact, but made by another version of brownpipe: {}",
}
PAGE = "report.html"  # made with the figures
PRODUCTS = (".png", ".svg", ".csv", ".txt", ".json", ".html")  # files of `brownpipe figures`, which have no seals
SHOWN = 3  # files that a remark names


class Verdict(NamedTuple):
    """What was found in the results of a study."""

    intact: int  # number of files
    problems: tuple[tuple[str, str], ...]  # file, relative to the folder of the results, and what is wrong with it
    remarks: tuple[str, ...]  # on files that are no problem
    cure: str | None  # command that makes again what is missing or damaged; None if none is known for this folder
    unknown: str | None = None  # why the study is unknown, so that files may be missing that no list names


class Results(NamedTuple):
    """The results of a study that are there, and those that it promises."""

    folder: Path  # absolute: the study is two folders above
    files: tuple[str, ...]  # that are there, relative to the folder
    record: RunRecord | None  # None: unknown
    study: Study | None  # None: unknown
    unknown: str | None  # why the study is unknown
    requests: Mapping[str, Request]  # of its trajectory files
    promised: frozenset[str]  # all files that the study makes, as far as they are known


Findings = Iterator[tuple[str, str | None]]  # file; what is wrong with it, or a key of REMARKS, or None


def results_in(path: str | Path) -> list[Path]:
    """Return the folder with the results of a study, or each of those in a folder of results.

    Raises WrongFileError, which says what can be verified instead, for any other folder.
    """
    path = Path(path)
    if _is_of_study(path):
        return [path]
    if found := sorted(folder for folder in path.iterdir() if folder.is_dir() and _is_of_study(folder)):
        return found
    absolute = _absolute(path)
    whole = next((folder for folder in absolute.parents if is_run_record(folder / RECORD)), None)
    if whole is not None:
        raise WrongFileError(f"{path}: is a part of {os.path.relpath(whole)}, which can only be verified as a whole")
    of_files = "single trajectory files, datasets, figures and tables can be verified by their names"
    raise WrongFileError(f"{path}: is not the folder of a study's results (results/STUDY); {of_files}")


def _absolute(folder: str | Path) -> Path:
    """Return an absolute path without `..`; a link is followed only if `..` may lead elsewhere behind it."""
    return Path(folder).resolve() if ".." in Path(folder).parts else Path(os.path.abspath(folder))


def _is_of_study(folder: Path) -> bool:
    """Whether a folder has the record of a study, or all that a damaged or missing record leaves of its results."""
    if is_run_record(folder / RECORD):
        return True
    absolute, has_parts = _absolute(folder), any((folder / part).is_dir() for part in PARTS)
    if absolute.parent.name == "results":
        return has_parts or likely_study(absolute) is not None
    return has_parts and os.path.lexists(folder / RECORD)


def verify_results(folder: str | Path) -> Verdict:
    """Verify everything that a study has made, given the folder of its results.

    Raises WrongFileError if there is none. Nothing is written.
    """
    if not os.path.isdir(folder):
        raise WrongFileError(f"{folder}: cannot be read: no such folder")
    results = _results(_absolute(folder))
    problems = dict.fromkeys(results.promised.difference(results.files), MISSING_FILE)
    remarks: dict[str, list[str]] = {key: [] for key in REMARKS}
    sealed = list(_sealed(results))
    broken = {file for file, what in sealed if what is not None and what not in REMARKS}
    for file, what in (*sealed, *_listed(results, broken)):
        if what in REMARKS:
            remarks[what].append(file)
        elif what is not None:
            problems.setdefault(file, what)
    intact = len({*results.files}.difference(problems, remarks[FOREIGN]))
    lines = tuple(REMARKS[key].format(_some(files)) for key, files in remarks.items() if files)
    cure, misplaced = None, _misplaced(results)
    if misplaced is not None:
        lines += (misplaced,)
    elif problems:
        cure = _cure(results, problems)
    return Verdict(intact, tuple(sorted(problems.items())), lines, cure, results.unknown)


def verify_file(path: str | Path) -> None:
    """Verify one file by its seal and digest, or by SHA256SUMS of its folder.

    Raises StorageError, which says how to make it again, if it is damaged; WrongFileError if brownpipe did not make it.
    """
    path, folder = Path(path), Path(path).parent
    if path.name == PAGE and not (folder / CHECKSUMS).exists():
        folder /= "figures"
    name, listed = os.path.relpath(path, folder), _checksums(folder)
    if name in listed:
        try:
            digest = digest_of(path)
        except OSError as error:
            raise WrongFileError(f"{path}: cannot be read: {error.strerror}") from error
        if digest != listed[name]:
            dataset = next((os.path.join(folder, name) for name in listed if name.endswith(".nc")), "DATASET.nc")
            again = f"brownpipe figures {shell_path(os.path.normpath(dataset))} --output {shell_path(folder)}"
            if path.name == PAGE:  # it may replay a run that is not in the dataset
                again = "delete it and run the study again"
            raise StorageError(f"{path}: was damaged or edited after it was written; {again}")
    elif path.is_file() and path.suffix.lower() in PRODUCTS:
        raise WrongFileError(f"{path}: must be verified where the study made it, as {CHECKSUMS} there lists it")
    else:
        read_contents(path)


# -- what there is --------------------------------------------------------------------------------------------------


def _results(folder: Path) -> Results:
    """Return the results in a folder, with their study if that is known."""
    files = tuple(sorted(_files(folder)))
    record, study, unknown, requests = None, None, None, {}
    try:
        record = _record(folder)
        study_file = os.path.relpath(folder.parent.parent / record.study)
        study = read_settled(study_file, record.config, folder / PLAN)
    except RequestError as error:
        unknown = str(error)
    if study is not None:
        start = f"results/{study.name}/"
        expected = [*expected_files(study), *replay_files(study)]
        requests = {str(path).removeprefix(start): request for path, request in expected}
    return Results(folder, files, record, study, unknown, requests, _promised(study, requests, files))


def _files(folder: Path) -> Iterator[str]:
    """Yield everything below a folder but folders, logs and benchmarks."""
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not (place == str(folder) and name in NO_RESULTS)]
        yield from (Path(place, name).relative_to(folder).as_posix() for name in names)


def _record(folder: Path) -> RunRecord:
    """Return how the study was run, with the file beside that study named like the results if that study is gone.

    Without a record the study file of that name, wherever it is.

    Raises RequestError, which says what is wrong with the record, if there is neither.
    """
    try:
        record = read_run_record(os.path.relpath(folder))
    except RequestError as error:
        likely = likely_study(folder)
        if likely is None:
            raise RequestError(f"{error}, and there is no study file {folder.name}.yaml") from error
        return RunRecord(likely)
    root, renamed = folder.parent.parent, os.path.join(os.path.dirname(record.study), f"{folder.name}.yaml")
    is_renamed = not os.path.isfile(root / record.study) and os.path.isfile(root / renamed)
    return record._replace(study=renamed) if is_renamed else record


def _promised(study: Study | None, requests: Mapping[str, Request], files: tuple[str, ...]) -> frozenset[str]:
    """Return all files that a study makes: those of the trade-off if there is one of them, the others unless only
    the trade-off was made."""
    promised = {RECORD, *(file for file in requests if file.startswith("simulate/"))}
    if study is None:
        return frozenset({RECORD})
    if study.tolerance is not None:
        promised.add(PLAN)
    of_tradeoff = {file for file in files if file.startswith("tradeoff/")}
    if not of_tradeoff or any(file.startswith(("aggregate/", "figures/")) for file in files):
        shown = [f"{name}.{kind}" for name in study.figures for kind in ("png", "svg", "csv")]
        promised |= {f"aggregate/{study.name}.nc", PAGE, *requests}  # with the run that the page replays
        promised |= {f"figures/{name}" for name in ("summary.txt", "summary.csv", "provenance.json", CHECKSUMS, *shown)}
    if of_tradeoff:
        promised.add(f"tradeoff/{study.name}.nc")
    if of_tradeoff - promised:  # brownpipe tradeoff makes only that file
        shown = [f"tradeoff_{name}.{kind}" for name in study.tradeoff_cases for kind in ("png", "svg")]
        names = (PAGE, "tradeoff.txt", "tradeoff.csv", "provenance.json", CHECKSUMS)
        promised |= {f"tradeoff/{name}" for name in (*names, *shown)}
    return frozenset(promised)


# -- files with a seal ----------------------------------------------------------------------------------------------


def _sealed(results: Results) -> Findings:
    """Verify trajectory files, datasets, plan and record by their seals, and whether they are of this study."""
    parts = ("figures", "tradeoff")
    listed = {os.path.normpath(f"{part}/{name}") for part in parts for name in _checksums(results.folder / part)}
    own = results.promised | listed | {f"{part}/{CHECKSUMS}" for part in parts}
    for file in tracked(results.files, "files"):
        path = results.folder / file
        try:
            if not path.is_file():
                yield file, "is no ordinary file" if file in own else FOREIGN
            elif file in (RECORD, PLAN):
                read_sealed_text(path)
                if not (is_run_record if file == RECORD else is_plan)(path):
                    yield file, "is another text than its name says"
            elif path.suffix == ".h5":
                yield file, _trajectories(results, file)
            elif path.suffix == ".nc":
                yield file, _dataset(results, file)
            elif file not in own:
                yield file, FOREIGN
        except WrongFileError as error:
            yield file, _cause(error) if file in own else FOREIGN
        except StorageError as error:
            yield file, _cause(error)


def _cause(error: StorageError) -> str:
    """Return what is wrong with a file, without its name and without the remedy."""
    return str(error.__cause__ if isinstance(error.__cause__, StorageError) else error)


def _trajectories(results: Results, file: str) -> str | None:
    """Return what is wrong with a trajectory file that is intact, or a key of REMARKS."""
    outline = read_trajectories(results.folder / file).outline
    request = results.requests.get(file)
    if request is not None and (wrong := difference(outline, request)):
        return wrong
    if file not in (_place(outline), _place(outline, "replay")):
        return f"holds the runs of {_place(outline)}"
    if request is None and results.study is not None:
        return SURPLUS
    is_older = outline.source != source_digest(*modules_of("simulate", outline.engine.name))
    return OLDER if is_older else None


def _place(outline: Outline, folder: str = "simulate") -> str:
    """Return the path at which a study stores these runs, relative to the folder of its results."""
    first, last = outline.seeds[[0, -1]].tolist()
    job = SimulationJob(outline.scene.name, outline.scene.particles, outline.engine.label, first, last)
    return f"{folder}/{job.file}"


def _dataset(results: Results, file: str) -> str | None:
    """Return what is wrong with a dataset that is intact, or a key of REMARKS."""
    dataset, study = read_dataset(results.folder / file), results.study
    if study is None or file not in results.promised:
        return None if study is None else SURPLUS
    step = "tradeoff" if is_tradeoff(dataset) else "aggregate"
    if not file.startswith(f"{step}/"):
        return f"is a dataset of `brownpipe {step}`"
    try:
        wrong = (_other_scenes if step == "tradeoff" else _other_runs)(dataset, results)
    except FigureError as error:
        return str(error)
    is_older = dataset.attrs.get("source_digest") != made_with(step)["source"]
    return wrong or (OLDER if is_older else None)


@of_whole_dataset
def _other_scenes(dataset: "Dataset", results: Results) -> str | None:
    """Return in what a trade-off departs from the study, in words."""
    assert results.study is not None
    digests = {
        name: case.digest for case in results.study.cases for name in (case.name, f"{case.name}_N{case.particles}")
    }
    found = dict(zip(dataset.scene.values.tolist(), dataset.digest.values.tolist(), strict=True))
    is_same = found == {name: digests[name] for name in results.study.tradeoff_cases}
    return None if is_same else "compares other scenes than the study"


@of_whole_dataset
def _other_runs(dataset: "Dataset", results: Results) -> str | None:
    """Return in what an analysis departs from the study, in words."""
    assert results.study is not None
    wanted: dict[tuple, list[int]] = {}
    for _, (scene, engine, seeds, *_) in expected_files(results.study):
        wanted.setdefault((scene.name, scene.particles, engine.label), []).extend(seeds)
    found = {}
    for case in cases_of(dataset):
        key = (case.scene.item(), case.particles.item(), case.engine.item())
        found[key] = case.seed.values[case.run_status.values != MISSING].tolist()
    if found != {key: sorted(seeds) for key, seeds in wanted.items()}:
        return "is of other runs than those of the study"
    if dataset.window.values.tolist() != labels(results.study.fit_windows):
        return "has other fit windows than the study"
    return None


# -- files with a line in SHA256SUMS --------------------------------------------------------------------------------


def _listed(results: Results, broken: Set[str]) -> Findings:
    """Compare figures, tables and texts with the checksums of their folders, and their dataset unless it is broken.

    If an intact dataset and a file drawn from it both differ from SHA256SUMS, the checksums are those of other results.
    """
    for part in ("figures", "tradeoff"):
        folder = results.folder / part
        sums = f"{part}/{CHECKSUMS}"
        try:
            listed = _within(read_checksums(folder))
        except WrongFileError:
            continue  # without the file, which is missing
        except StorageError as error:
            yield sums, str(error)
            continue
        of_part = (f"{part}/", PAGE) if part == "figures" else f"{part}/"
        promised = {file for file in results.promised if file.startswith(of_part)} - {sums}
        files = {name: os.path.normpath(f"{part}/{name}") for name in listed}
        yield from ((file, "has no checksum") for file in promised.difference(files.values()))
        yield from ((files[name], MISSING_FILE) for name in listed if not os.path.lexists(folder / name))
        there = [name for name in listed if files[name] not in broken and (folder / name).is_file()]
        differing = [name for name in there if digest_of(folder / name) != listed[name]]
        datasets = {name for name in differing if name.endswith(".nc")}
        if datasets and len(differing) > len(datasets):
            yield sums, "is of other results than those in its folder"
            continue
        for name in differing:
            edited = "was damaged or edited after it was written"
            yield files[name], "is not the dataset that the figures show" if name in datasets else edited


def _checksums(folder: Path) -> Mapping[str, str]:
    """Return the checksums in a folder of the results, none if they cannot be read."""
    try:
        return _within(read_checksums(folder))
    except StorageError:
        return {}


def _within(checksums: Mapping[str, str]) -> dict[str, str]:
    """Return the checksums of files within the results, given those in one of their folders."""
    inside = (name for name in checksums if not os.path.isabs(name))
    return {name: checksums[name] for name in inside if not os.path.normpath(f"part/{name}").startswith("..")}


# -- what makes it again --------------------------------------------------------------------------------------------


def _misplaced(results: Results) -> str | None:
    """Return in words that a folder is not the one in which the study makes its results; None if it is, or unknown."""
    if results.record is None or results.study is None:
        return None
    place = f"results/{results.study.name}"
    if results.folder.parts[-2:] == Path(place).parts:
        return None
    return f"is not named {place}, after its study: {results.record.command()} makes files again only there"


def _cure(results: Results, problems: Mapping[str, str]) -> str | None:
    """Return the command that deletes what is wrong and makes again all that the study promises, if that is known."""
    if results.record is None or results.study is None:
        return None
    root = results.folder.parent.parent
    steps = [] if root.resolve() == Path.cwd() else [f"cd {shell_path(root.resolve())}"]
    if wrong := sorted(file for file, what in problems.items() if what != MISSING_FILE):
        paths = " ".join(shell_path(f"results/{results.folder.name}/{file}") for file in wrong)
        steps.append(f"rm -rf -- {paths}")
    of_tradeoff = [file.startswith("tradeoff/") for file in problems]
    has_figures = f"figures/{CHECKSUMS}" in results.promised
    if has_figures and not all(of_tradeoff):
        steps.append(results.record.command())
    if any(of_tradeoff) or not has_figures:
        steps.append(results.record.command("tradeoff_figures"))
    return " && ".join(steps)


def _some(files: list[str]) -> str:
    """Return the first of some files, and how many more there are."""
    shown = ", ".join(map(printable, files[:SHOWN]))
    return shown if len(files) <= SHOWN else f"{shown} and {len(files) - SHOWN} more"
