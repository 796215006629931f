"""The workflow of a study, run by Snakemake in the current folder: simulate, aggregate, figures.

An installed brownpipe has the workflow in its folder `pipeline`; a checkout has the same files at its top.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

import yaml

from brownpipe import interrupts
from brownpipe.errors import RequestError, RunError
from brownpipe.provenance import PACKAGE
from brownpipe.quoting import shell_word
from brownpipe.scene.yaml_file import read_yaml
from brownpipe.study.study_file import MOST_STUDY_BYTES, read_study

WRITTEN = (".", "results", ".snakemake")  # folders that a study writes to
PAGES = (".html", ".zip")  # suffixes of a report
INTERRUPTED = 128 + signal.SIGINT
# As `python -m snakemake`, but without a traceback if Ctrl-C comes before Snakemake is ready for it.
SNAKEMAKE = f"""\
import sys
sys.argv[0] = "snakemake"
try:
    from snakemake.cli import main
    main()
except KeyboardInterrupt:
    sys.exit({INTERRUPTED})
"""


def pipeline_folder() -> Path:
    """Return the folder with the Snakefile, its profile and the example configurations."""
    installed = PACKAGE / "pipeline"
    return installed if installed.is_dir() else PACKAGE.parents[1]


def run_study(
    study_file: str,
    cores: int | None = None,
    dry_run: bool = False,
    report: str | None = None,
    further: Sequence = (),
    profile: str | None = None,
) -> int:
    """Run the workflow of a study by Snakemake with results in `results/` of the current folder; return its status.

    `cores`: number of jobs at the same time (None: all cores, or as many as the profile says). `dry_run`: only list the
    jobs. `report`: HTML or ZIP file for the report, written once the results are complete, also if more runs failed
    than the study allows, which still makes the status 1. `further`: arguments for Snakemake, such as targets.
    `profile`: where the jobs run (`profile_folder`); None: on this machine.

    Raises RequestError for a mistake in the study or in the arguments, PermissionError if the current folder cannot be
    written to. Mistakes in keys that `further` replaces by --config are reported by Snakemake.
    """
    if not is_changed_by(further):
        read_study(study_file)
    if report is not None and dry_run:
        raise RequestError(f"--report {report}: must not be given with -n, which runs nothing")
    if report is not None and Path(report).suffix not in PAGES:
        raise RequestError(f"--report {report}: must end in {' or '.join(PAGES)}")
    if report is not None and not os.access(Path(report).parent, os.W_OK):
        raise RequestError(f"--report {report}: its folder is missing or cannot be written to; choose another place")
    for folder in filter(os.path.exists, WRITTEN):
        if not os.access(folder, os.W_OK):
            where = Path.cwd() if folder == "." else folder
            raise PermissionError(f"{where}: cannot be written to; run the study from another folder")
    command = snakemake_command(study_file, cores, further, profile)
    environment = environment_of(study_file)
    if profile is not None and not dry_run and "simulate" in _planned(command, environment):
        first = snakemake_command(study_file, cores, ["compile", *further, "--until", "compile"], profile)
        if status := _wait_for(first, environment):
            return status
    status = _wait_for([*command, "--dry-run"] if dry_run else command, environment)
    if report is None or (status and _unfinished(command, environment)):
        return status
    return _wait_for([*command, "--report", report], environment) or status


def planned_jobs(study_file: str, cores: int | None = None, profile: str | None = None) -> str:
    """Return in one line which jobs `run_study` would run.

    Raises RequestError for a mistake in the study or in the profile, RunError with Snakemake's last line if it cannot
    plan the jobs.
    """
    read_study(study_file)
    jobs = _planned(snakemake_command(study_file, cores, profile=profile), environment_of(study_file))
    words = [f"{rule} {count}" for rule, count in jobs.items()]
    return f"to run: {', '.join(words)}" if words else "nothing to run: all results are there and up to date"


def _unfinished(command: list[str], environment: dict[str, str]) -> bool:
    """Whether a study that has ended with an error lacks results."""
    try:
        return bool(_planned(command, environment))
    except RunError:
        return True


def _planned(command: list[str], environment: dict[str, str]) -> dict[str, str]:
    """Return the number of jobs by rule that Snakemake would run to make results; errors as of `planned_jobs`."""
    command = [*command, "--dry-run"]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode:
        raise RunError(([*filter(None, done.stdout.splitlines())] or ["Snakemake failed"])[-1])
    _, _, table = done.stdout.partition("Job stats:\n")
    counts = dict(re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE))
    return {rule: count for rule, count in counts.items() if rule not in ("all", "total")}


def is_changed_by(further: Sequence) -> bool:
    """Whether arguments for Snakemake replace keys of the study, by --config or another --configfile."""
    return any(word.startswith(("--config", "-C")) for word in further)


def snakemake_command(
    study_file: str, cores: int | None = None, further: Sequence = (), profile: str | None = None
) -> list[str]:
    """Return the command that runs the workflow of a study; it does not import Python files of the current folder.

    Raises RequestError for a profile that cannot be used.
    """
    if profile is not None and "'" in f"{Path.cwd()}{study_file}":
        raise RequestError(f"--profile {profile}: must not be given where a path has an apostrophe: {Path.cwd()}")
    folder = pipeline_folder()
    files = ["--snakefile", folder / "Snakefile", "--configfile", study_file]
    if profile is None:
        place = ["--cores", str(cores or "all")]
    else:
        place = ["--profile", str(profile_folder(profile)), *(["--jobs", str(cores)] if cores else [])]
    words = [*files, *_options_of_profile(folder), *place, *further]
    return [sys.executable, "-P", "-c", SNAKEMAKE, *map(str, words)]


def profile_folder(profile: str) -> Path:
    """Return the folder of a profile of Snakemake, which says where jobs run: `profile` itself, or one of brownpipe's.

    Raises RequestError if there is none, or if Snakemake's plugin for its executor is not installed.
    """
    own = pipeline_folder() / "profiles"
    names = sorted(path.parent.name for path in own.glob("*/config.yaml") if path.parent.name != "default")
    folders = [Path(profile).absolute(), *(own / name for name in names if name == profile)]
    folder = next((folder for folder in folders if (folder / "config.yaml").is_file()), None)
    if folder is None:
        raise RequestError(f"--profile {profile}: must be a folder with config.yaml, or one of {', '.join(names)}")
    options = read_yaml(folder / "config.yaml", MOST_STUDY_BYTES)
    executor = str(options.get("executor", "local")) if isinstance(options, dict) else "local"
    if executor != "local" and not find_spec(f"snakemake_executor_plugin_{executor.replace('-', '_')}"):
        package = f"snakemake-executor-plugin-{executor}"
        raise RequestError(f"--profile {profile}: there is no {package} here; install it by pip")
    return folder


def _options_of_profile(folder: Path) -> list[str]:
    """Return the options of the workflow's profile; given the profile itself, Snakemake would begin with its path."""
    profile = yaml.safe_load((folder / "profiles" / "default" / "config.yaml").read_text())
    options = [[f"--{key}"] if value is True else [f"--{key}", str(value)] for key, value in profile.items()]
    return ["--workflow-profile", "none", *chain.from_iterable(options)]


def environment_of(study_file: str) -> dict[str, str]:
    """Return the environment of the workflow.

    This installation's `brownpipe` comes first in PATH, which need not have it. UNLOCK_COMMAND is shown where it is
    needed.
    """
    own = _own_command()
    called = ["brownpipe" if own is None or _is_same(shutil.which("brownpipe"), own) else str(own), "run", study_file]
    shown = {"UNLOCK_COMMAND": " ".join(map(shell_word, [*called, "--", "--unlock"]))}  # to be copied from the screen
    path = os.environ.get("PATH", os.defpath)
    return os.environ | shown | {"PATH": path if own is None else f"{own.parent}{os.pathsep}{path}"}


def _own_command() -> Path | None:
    """Return the program `brownpipe` of this installation; None if it was installed without one."""
    folders = [sysconfig.get_path("scripts"), sysconfig.get_path("scripts", sysconfig.get_preferred_scheme("user"))]
    programs = [Path(sys.argv[0]).absolute(), *(Path(folder) / "brownpipe" for folder in folders)]
    return next((path for path in programs if path.name == "brownpipe" and os.access(path, os.X_OK)), None)


def _is_same(one: str | None, other: Path) -> bool:
    return one is not None and os.path.samefile(one, other)


def _wait_for(command: list[str], environment: dict[str, str]) -> int:
    """Run Snakemake and return its exit status, as a shell would. It ends by itself at Ctrl-C, which it gets, too.

    Raises KeyboardInterrupt if that came before Snakemake was ready to say so.
    """
    with interrupts.passed_on(), subprocess.Popen(command, env=environment) as process:
        while process.returncode is None:
            try:
                process.wait()
            except KeyboardInterrupt:
                continue
            except SystemExit:  # raised for SIGTERM, which only this process gets
                process.send_signal(signal.SIGTERM)
                raise
    if process.returncode == INTERRUPTED:
        raise KeyboardInterrupt
    return process.returncode if process.returncode >= 0 else 128 - process.returncode
