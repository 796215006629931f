"""The set-up of a newcomer: what is installed, and one clear line for whatever a machine may lack. Without a network.

`python3`, `uv` and pip are fakes: shell scripts that say and do what the real ones do in that state.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, distribution, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
LOCKS = ("requirements.lock", "requirements-dev.lock", "requirements-docs.lock", "requirements-cluster.lock")
REAL = getattr(sys, "_base_executable", None) or sys.executable
BASICS = "/usr/bin:/bin"
INSIDE = """\
#!/bin/bash
# the python of an environment, with a pip that behaves as told
case "$*" in
    *"-m pip --version"*) exit 0 ;;
    *"-m pip install"*) echo "$@" >> pip.calls; source ./pip.behaviour ;;
    *) exec {real} "$@" ;;
esac
"""
MAKES_VENV = """\
#!/bin/bash
# a python3 whose venv module makes a folder with a python that pip.behaviour tells what to do
if [[ "$1 $2" == "-m venv" ]]; then
    mkdir -p "$3/bin" && cp inside "$3/bin/python" && chmod +x "$3/bin/python"
else
    exec {real} "$@"
fi
"""
WORKS = "echo Collecting numpy; echo Installing collected packages: numpy"
UNREACHABLE = """\
echo "WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError: failed': /simple/numpy/"
echo "ERROR: Could not find a version that satisfies the requirement numpy==2.4.6 (from versions: none)"
echo "ERROR: No matching distribution found for numpy==2.4.6"
exit 1"""
BY_PIP = """\
ERROR: THESE PACKAGES DO NOT MATCH THE HASHES FROM THE REQUIREMENTS FILE. If you have updated the package versions, ...
    attrs==26.1.0 from file:///attrs-26.1.0-py3-none-any.whl#sha256=c647 (from -r requirements.lock (line 9)):
        Expected sha256 0000
             Got        c647
"""
BY_UV = """\
error: Failed to download `attrs==26.1.0`
  cause: Hash mismatch for `attrs==26.1.0`
"""
FULL = 'echo "ERROR: Could not install packages due to an OSError: [Errno 28] No space left on device"; exit 1'
LACKING = 'echo "ERROR: No matching distribution found for numpy==2.4.6"; exit 1'


def program(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text.format(real=REAL))
    path.chmod(0o755)


@pytest.fixture
def checkout(tmp_path):
    """What the set-up needs of a checkout, and a folder `fakes` that is first on PATH."""
    folder = tmp_path / "checkout"
    (folder / "workflow").mkdir(parents=True)
    for name in ("Makefile", "pyproject.toml", *LOCKS, "workflow/set_up.py"):
        shutil.copy(ROOT / name, folder / name)
    program(folder / "inside", INSIDE)
    (folder / "pip.behaviour").write_text(WORKS)
    program(folder / "fakes" / "python3", MAKES_VENV)
    return folder


def set_up(folder, target="ready", path=None, **more):
    """The exit status of `make`, the lines of the set-up on stderr, and how often pip was called."""
    calls = folder / "pip.calls"
    calls.unlink(missing_ok=True)
    surroundings = {"PATH": path or f"{folder / 'fakes'}:{BASICS}", "HOME": str(folder)} | more
    # set_up.py asks its own interpreter for venv: let the fake be that one
    text = (ROOT / "workflow" / "set_up.py").read_text()
    here = re.compile(r"^PYTHON_HERE = .*$", re.MULTILINE)
    (folder / "workflow" / "set_up.py").write_text(here.sub(f'PYTHON_HERE = "{folder}/fakes/python3"', text))
    command = ["make", "--silent", target]
    done = subprocess.run(
        command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=60, check=False
    )
    lines = [line for line in done.stderr.splitlines() if not line.startswith("make")]
    return done.returncode, lines, len(calls.read_text().splitlines()) if calls.exists() else 0


# -- what is installed ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_it_installs_once_and_says_what(checkout):
    status, lines, calls = set_up(checkout)
    assert (status, calls) == (0, 2)  # the packages, and brownpipe itself
    count = (ROOT / "requirements.lock").read_text().count("==")
    assert f"brownpipe: set-up: installing {count} packages with pip" in lines
    assert re.fullmatch(rf"brownpipe: set-up: {count} packages installed in \d+ s", lines[-1])
    assert set_up(checkout) == (0, [], 0)
    status, lines, calls = set_up(checkout, "ready_dev")
    assert (status, calls) == (0, 1)  # only what tests and linters need besides
    assert set_up(checkout, "ready_dev") == (0, [], 0)
    assert set_up(checkout, "ready_docs")[::2] == (0, 1)
    assert set_up(checkout, "ready_cluster")[::2] == (0, 1)


@pytest.mark.parametrize(("environment", "later"), [({}, True), ({"PYTHONDONTWRITEBYTECODE": "1"}, False)])
def test_byte_code_is_compiled_later_where_it_is_then_kept(checkout, environment, later):
    set_up(checkout, **environment)
    assert all(("--no-compile" in call) == later for call in (checkout / "pip.calls").read_text().splitlines())


def test_other_pins_are_installed(checkout):
    set_up(checkout)
    with open(checkout / "requirements.lock", "a") as file:
        file.write("another==1.0\n")
    status, lines, calls = set_up(checkout)
    assert (status, calls) == (0, 2)
    assert "made again" not in "".join(lines)


def test_uv_is_used_where_it_is(checkout):
    program(
        checkout / "fakes" / "uv",
        "#!/bin/bash\necho $* >> uv.calls\nif [[ $1 == venv ]]; then exec fakes/python3 -m venv ${{@: -1}}; fi\n",
    )
    status, lines, calls = set_up(checkout)
    assert (status, calls) == (0, 0)
    assert [line.split()[0] for line in (checkout / "uv.calls").read_text().splitlines()] == ["venv", "pip", "pip"]
    assert any(line.endswith("packages with uv") for line in lines)


@pytest.mark.promise("altered package", "A package that is not the pinned file, by its SHA-256, is not installed.")
@pytest.mark.parametrize("said", [BY_PIP, BY_UV], ids=["pip", "uv"])
def test_a_package_that_is_not_the_pinned_file_is_refused(checkout, said):
    (checkout / "pip.behaviour").write_text(f"cat <<'END'\n{said}END\nexit 1\n")
    status, lines, calls = set_up(checkout)
    assert "--require-hashes" in (checkout / "pip.calls").read_text()
    other = "another file as attrs==26.1.0 than the one pinned: its SHA-256 is none of the lock file"
    assert (status != 0, calls, lines[-1]) == (True, 1, f"brownpipe: set-up: the index offers {other}")
    assert not (checkout / ".venv").exists()


@pytest.mark.promise("altered package", "Every pinned version has the SHA-256 of its files, and no pin names a host.")
@pytest.mark.parametrize("lock", LOCKS)
def test_every_pin_has_hashes_and_no_host(lock):
    lines = [line for line in (ROOT / lock).read_text().splitlines() if not line.startswith("#")]
    pins = re.split(r"\n(?=\S)", "\n".join(lines))
    hashes = r"( \\\n    --hash=sha256:[0-9a-f]{64})+"
    assert [pin for pin in pins if not re.fullmatch(rf"[\w.-]+==[\w.+]+{hashes}", pin)] == []
    assert len(pins) >= {"requirements-cluster.lock": 2}.get(lock, 20)


def normal(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def pins_of(lock):
    """Names and versions of the packages of a lock file."""
    pins = (line.split()[0].partition("==") for line in (ROOT / lock).read_text().splitlines() if "==" in line)
    return {name: version for name, _, version in pins}


def is_installed(name):
    with suppress(PackageNotFoundError):
        return bool(distribution(name))
    return False


def needed(roots):
    """The names of packages and of all that these depend on, here. Packages that are not installed need nothing."""
    found, rest = set(), [Requirement(root) for root in roots]
    while rest:
        one = rest.pop()
        if normal(one.name) not in found and (one.marker is None or one.marker.evaluate({"extra": ""})):
            found.add(normal(one.name))
            with suppress(PackageNotFoundError):
                rest += map(Requirement, requires(one.name) or [])
    return found


def test_the_pins_are_complete_and_a_study_needs_no_tools_of_developers():
    run, dev, docs, cluster = ({normal(name) for name in pins_of(lock)} for lock in LOCKS)
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = settings["project"]
    assert run == needed([*project["dependencies"], *settings["build-system"]["requires"]])
    assert run | dev == run | needed(project["optional-dependencies"]["dev"])
    assert not run & (dev | docs | cluster)
    asked = needed(project["optional-dependencies"]["cluster"])
    assert asked - run <= cluster  # equal where they are installed, as below
    assert not is_installed("snakemake-executor-plugin-slurm") or cluster == asked - run
    asked = needed(project["optional-dependencies"]["docs"])
    assert asked - run <= docs  # equal where `make docs` has installed them: other packages are not known to need any
    assert not is_installed("sphinx") or docs == asked - run


def test_what_two_locks_pin_has_one_version():
    dev, docs = (pins_of(lock) for lock in LOCKS[1:3])
    assert {name: docs[name] for name in docs if name in dev} == {name: dev[name] for name in dev if name in docs}


# -- what a machine may lack ----------------------------------------------------------------------------------------


def test_no_python(checkout):
    path = checkout / "bin"
    path.mkdir()
    for name in ("make", "bash", "nproc"):
        (path / name).symlink_to(shutil.which(name))
    status, lines, _ = set_up(checkout, path=str(path))
    assert status != 0
    assert lines == ["brownpipe: set-up: there is no python3; needed is python3 >= 3.11"]


def test_python_too_old(checkout):
    program(
        checkout / "fakes" / "python3",
        "#!/bin/bash\nexec {real} -c 'import runpy, sys; sys.version_info = (3, 9, 2); sys.argv[:] = sys.argv[1:];"
        ' runpy.run_path(sys.argv[0], run_name="__main__")\' "$@"\n',
    )
    status, lines, _ = set_up(checkout)
    assert status != 0
    assert re.fullmatch(r"brownpipe: set-up: needs python3 >= 3.11, and .* is 3.9; another one: make .*", *lines)


@pytest.mark.parametrize(
    "said",
    [
        "The virtual environment was not created successfully because ensurepip is not available.",
        "No module named venv",
    ],
)
def test_no_venv_module(checkout, said):
    fails = f'mkdir -p $3/bin; echo "{said}"; exit 1'  # Debian without python3-venv leaves a folder without pip
    text = f'#!/bin/bash\nif [[ "$1 $2" == "-m venv" ]]; then {fails}; fi\nexec {{real}} "$@"\n'
    program(checkout / "fakes" / "python3", text)
    status, lines, _ = set_up(checkout)
    assert status != 0
    assert lines[-1].startswith("brownpipe: set-up: ")
    assert lines[-1].endswith("lacks its module venv or ensurepip (Debian, Ubuntu: sudo apt install python3-venv)")
    assert not (checkout / ".venv").exists()


@pytest.mark.parametrize(
    ("behaviour", "cause"),
    [
        (UNREACHABLE, "no network, or none that leads to the package index"),
        (FULL, "the disk is full"),
        (LACKING, "the package index lacks a pinned package"),
        ('echo "ERROR: something new"; exit 1', "ERROR: something new"),
        ("exit 1", "it failed without a word"),
    ],
)
def test_pip_fails(checkout, behaviour, cause):
    (checkout / "pip.behaviour").write_text(behaviour)
    status, lines, _ = set_up(checkout)
    assert status != 0
    assert lines[-1] == f"brownpipe: set-up: {cause}"
    assert not (checkout / ".venv").exists()
    (checkout / "pip.behaviour").write_text(WORKS)
    assert set_up(checkout)[0] == 0


def test_a_full_disk_while_packages_are_renewed_leaves_the_old_ones(checkout):
    set_up(checkout)
    (checkout / "pip.behaviour").write_text(FULL)
    (checkout / "requirements.lock").write_text("another==1.0\n")
    assert set_up(checkout)[1][-1] == "brownpipe: set-up: the disk is full"
    assert (checkout / ".venv" / "bin" / "python").exists()


def break_python(folder):
    (folder / ".venv" / "bin" / "python").unlink()
    (folder / ".venv" / "bin" / "python").symlink_to("/nowhere/python3.11")


def lose_pip(folder):
    (folder / ".venv" / "installed-run").unlink()
    program(folder / ".venv" / "bin" / "python", '#!/bin/bash\n[[ "$2" == pip ]] && exit 1\nexec {real} "$@"\n')


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (break_python, "is broken: its python does not start or is too old"),
        (lose_pip, "is broken: it has no pip"),
        (lambda folder: (folder / ".venv" / "installed-run").write_text("/elsewhere 0"), "is of another folder"),
    ],
)
def test_a_broken_environment_is_made_again(checkout, damage, why):
    set_up(checkout)
    damage(checkout)
    status, lines, calls = set_up(checkout)
    assert (status, calls) == (0, 2)
    assert lines[0].startswith(f"brownpipe: set-up: .venv {why}")
    assert lines[0].endswith("made again")
    assert set_up(checkout) == (0, [], 0)


def test_a_checkout_that_cannot_be_written_to(checkout, monkeypatch, capsys):
    """Asked of the functions: to root, who may run the tests, every folder is writable."""
    told = importlib.util.spec_from_file_location("set_up", checkout / "workflow" / "set_up.py")
    module = importlib.util.module_from_spec(told)
    told.loader.exec_module(module)
    monkeypatch.chdir(checkout)
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert module.main() == 1
    assert (
        capsys.readouterr().err == f"brownpipe: set-up: {checkout} cannot be written to; take a copy of it elsewhere\n"
    )
    assert not (checkout / ".venv").exists()
