"""The workflow of a study, run by Snakemake in the current folder: simulate, aggregate, figures.

An installed brownpipe has the workflow in its folder `pipeline`; a checkout has the same files at
its top.
"""

import fcntl
import json
import os
import re
import shlex
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from logging import Logger
from pathlib import Path
from typing import NoReturn

from brownpipe.errors import BrownpipeError, RequestError
from brownpipe.progress import give_reason
from brownpipe.provenance import PACKAGE
from brownpipe.scene.reading import YamlValue, read_yaml, scalar
from brownpipe.storage.store import DIGITS
from brownpipe.study.run_sets import run_sets, seconds_of_jobs
from brownpipe.study.study import Study, read_study
from brownpipe.text import counted, in_time, shell_path

LOCKS = Path(".snakemake/locks")
# Snakemake with one line for an interruption while it starts, of which it makes a traceback
PROGRAM = "from brownpipe import processes; processes.run_program('snakemake', 'brownpipe run')"
WILDCARD = re.compile(r"\{\s*(\w+)\s*(?:,([^{}]*))?\}")  # in a path, as Snakemake understands it
OPTION_AND_KEY = "--batch"  # of Snakemake an option, of studies a key
_held: list[int] = []  # the open file that says that a Snakemake is alive in this folder


def pipeline_folder() -> Path:
    """Return the folder with the Snakefile, its profiles and the example configurations."""
    installed = PACKAGE / "pipeline"
    return installed if installed.is_dir() else PACKAGE.parents[1]


# -- for the Snakefile -----------------------------------------------------------------------------


@contextmanager
def ended_by_mistakes() -> Iterator[None]:
    """End the process with one line, not with a traceback of Snakemake, for a mistake or a file
    that is damaged.
    """
    try:
        yield
    except BrownpipeError as error:
        give_reason(str(error))
        print(f"brownpipe: {error}", file=sys.stderr)
        sys.exit(error.exit_status)


@ended_by_mistakes()
def read_workflow_study(
    files: Sequence[str | Path], config: Mapping[str, YamlValue]
) -> tuple[Study, str]:
    """Return the study of --configfile and --config, and the words that name it in commands of
    brownpipe.

    Keys of later files replace those of the first, as Snakemake has it.
    """
    first, *others = (os.path.relpath(file) for file in files)
    replaced: dict[str, YamlValue] = {}
    for file in others:
        replaced |= read_yaml(file)
    for key, value in config.items():
        replaced[key] = from_command_line(value)
    study = read_study(first, replaced)
    words = [shell_path(first)]
    if replaced:
        words.append("--config")
    for key, value in replaced.items():
        words.append(shlex.quote(f"{key}={json.dumps(value)}"))
    return study, " ".join(words)


def from_command_line(value: YamlValue) -> YamlValue:
    """Return a value of `snakemake --config KEY=VALUE` with the type that it has in a study file.

    Snakemake reads numbers inside lists and mappings, null, true and false as text.
    """
    if isinstance(value, dict):
        return {key: from_command_line(item) for key, item in value.items()}
    if isinstance(value, list):
        return [from_command_line(item) for item in value]
    return scalar(value) if isinstance(value, str) else value


def remove_stale_locks() -> None:
    """Remove Snakemake's locks of this folder if no Snakemake is alive in it: one was killed, or
    the machine went down.

    Every Snakemake keeps a file locked until its process ends, however it ends.
    """
    with suppress(OSError):  # the file system cannot tell
        LOCKS.mkdir(parents=True, exist_ok=True)
        _held.append(os.open(LOCKS.parent / "brownpipe.lock", os.O_WRONLY | os.O_CREAT))
        with suppress(BlockingIOError):  # there is one
            fcntl.flock(_held[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
            for lock in LOCKS.iterdir():
                lock.unlink(missing_ok=True)
        # shared: a dry run does not keep a study from having one
        fcntl.flock(_held[-1], fcntl.LOCK_SH)


def say_forecast(study: Study, files: Sequence[str], logger: Logger) -> None:
    """Say what it will take to simulate the files of runs that are due.

    The logger plugin derives the time left from it.
    """
    costs = {runs.key: runs.cost for runs in run_sets(study)}
    runs: dict[str, int] = {}
    seconds: dict[str, float] = {}
    for file in files:
        path = Path(file)
        first, last = map(int, path.stem.split("-"))
        cost = costs[path.parent.name[-DIGITS:]]
        runs[file] = last - first + 1
        seconds[file] = seconds_of_jobs(cost, runs[file])
    work = f"{counted(sum(runs.values()), 'run')} in {counted(len(runs), 'job')}"
    cpu = in_time(sum(seconds.values()))
    logger.info(
        f"brownpipe: the study {study.name}: {work}, some {cpu} of CPU",
        extra={"runs": runs, "seconds": seconds},
    )


# -- brownpipe run ---------------------------------------------------------------------------------


def require_snakemake() -> None:
    """Raise RequestError if Snakemake is not installed. Runs and their analysis need none."""
    if not find_spec("snakemake"):
        raise RequestError("studies need Snakemake: pip install 'brownpipe[study]'")


def run_study(
    study_file: str, cores: int | None, profile: str | None, further: Sequence[str]
) -> NoReturn:
    """Become the Snakemake that runs the workflow of a study, with results in `results` of the
    current folder.

    cores: jobs at the same time (None: all cores, or as many as the profile says). profile: where
    the jobs run (`profile_folder`); None: on this machine. further: other arguments of Snakemake,
    such as targets.
    Raises RequestError without Snakemake, for a file that is no YAML, a second study, keys of the
    study in a wrong place and a profile that cannot be used, or in a folder whose name Snakemake
    takes for a wrong wildcard, PermissionError if the folder cannot be written to. The Snakefile
    refuses all other mistakes.
    """
    require_snakemake()
    read_yaml(study_file)
    is_second = bool(further) and further[0].endswith(".yaml") and "=" not in further[0]
    if is_second or any(word.startswith("--configfile") for word in further):
        raise RequestError(
            f"{study_file}: must be the only study; --config KEY=VALUE replaces its keys"
        )
    _refuse_misplaced_keys(further)
    if not os.access(".", os.W_OK):
        raise PermissionError(
            f"{Path.cwd()}: cannot be written to; run the study from another folder"
        )
    try:
        for name, pattern in WILDCARD.findall(str(Path.cwd())):
            re.compile(f"(?P<{name}>{pattern})")
    except re.error:
        raise RequestError(
            f"{Path.cwd()}: Snakemake cannot run in a folder with such braces in its path; run the "
            "study from another folder"
        ) from None
    command = [sys.executable, "-P", "-c", PROGRAM]
    command += ["--snakefile", str(pipeline_folder() / "Snakefile")]
    command += ["--configfile", study_file]
    if profile is None:
        command += ["--cores", str(cores or "all")]
    else:
        command += ["--profile", str(profile_folder(profile))]
        if cores:
            command += ["--jobs", str(cores)]
    command += further
    path = os.environ.get("PATH", os.defpath)
    environment = {**os.environ}
    environment["PATH"] = os.pathsep.join([sysconfig.get_path("scripts"), path])
    environment |= cache_folder(profile is not None)
    os.execve(sys.executable, command, environment)


def _refuse_misplaced_keys(further: Sequence[str]) -> None:
    """Raise RequestError for a key of the study as an option, and for a word behind --config that
    is not KEY=VALUE. Snakemake answers the first by its hundred options, the second by a traceback.
    """
    options_of_keys = {"--" + key.replace("_", "-"): key for key in Study.model_fields}
    del options_of_keys[OPTION_AND_KEY]
    option = ""
    for word in further:
        if word.startswith("-"):
            option = word.partition("=")[0].replace("_", "-")
            key = options_of_keys.get(option)
            if key:
                raise RequestError(
                    f"{option}: is no option; --config {key}=VALUE replaces the key of the study"
                )
        elif option in ("--config", "-C") and "=" not in word:
            raise RequestError(f"{option}: must be KEY=VALUE, like seeds=100, not {word!r}")


def cache_folder(is_shared: bool) -> dict[str, str]:
    """Return the setting of the environment that has Snakemake and Matplotlib keep their caches in
    the current folder, where the user's home cannot be written to; {} where it can.

    is_shared: whether jobs run on other machines, whose homes are not known here.
    """
    here = {"XDG_CACHE_HOME": str(LOCKS.parent.absolute() / "cache")}
    if is_shared:
        return here
    with suppress(OSError, RuntimeError):  # RuntimeError: the user has no home
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        usual = caches / "snakemake"
        usual.mkdir(parents=True, exist_ok=True)
        if os.access(usual, os.W_OK):
            return {}
    return here


def profile_folder(profile: str) -> Path:
    """Return the folder of a profile of Snakemake, which says where jobs run: `profile` itself, or
    one of brownpipe's.

    Raises RequestError if it has no config.yaml, or if Snakemake's plugin for its executor is not
    installed.
    """
    folder = pipeline_folder() / "profiles" / profile
    if Path(profile).is_dir():
        folder = Path(profile).absolute()
    settings = read_yaml(folder / "config.yaml")
    executor = str(settings.get("executor", "local"))
    plugin = f"snakemake_executor_plugin_{executor.replace('-', '_')}"
    if executor != "local" and not find_spec(plugin):
        raise RequestError(
            f"--profile {profile}: needs snakemake-executor-plugin-{executor}; install it by pip"
        )
    return folder
