"""The set-up of a newcomer: what is installed, and one clear line for what a machine may lack.
Without a network.

`python3`, pip and uv are fakes: shell scripts that say and do what the real ones do in that state.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LOCKS = (
    "requirements.lock",
    "requirements-dev.lock",
    "requirements-docs.lock",
    "requirements-cluster.lock",
)
REAL = getattr(sys, "_base_executable", None) or sys.executable
INSTALLER = """\
#!/bin/bash
[[ $* == *" uv" && -e uv ]] && cp uv .venv/bin
[[ $* == *" uv" ]] || echo "$@" >> $(basename $0).calls
exit $(cat status)
"""
PYTHON3 = f"""\
#!/bin/bash
if [[ "$1 $2" == "-m venv" ]]; then
    mkdir -p "$3/bin" && cp inside "$3/bin/python"
else
    exec {REAL} "$@"
fi
"""


def program(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


@pytest.fixture
def checkout(tmp_path):
    """What the set-up needs of a checkout, and a folder `fakes` that is first on PATH."""
    for name in ("Makefile", "pyproject.toml", *LOCKS):
        shutil.copy(ROOT / name, tmp_path / name)
    program(tmp_path / "inside", INSTALLER)
    program(tmp_path / "fakes" / "python3", PYTHON3)
    (tmp_path / "status").write_text("0")
    return tmp_path


def set_up(folder, target="ready", by="python"):
    """The exit status of `make`, the lines of the set-up on stderr, and what pip or uv was asked
    for (not uv).
    """
    calls = folder / f"{by}.calls"
    calls.write_text("")
    surroundings = {"PATH": f"{folder / 'fakes'}:/usr/bin:/bin", "HOME": str(folder)}
    command = ["make", "--silent", target]
    done = subprocess.run(
        command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=60
    )
    lines = [line for line in done.stderr.splitlines() if not line.startswith("make")]
    return done.returncode, lines, calls.read_text().splitlines()


@pytest.mark.parametrize(
    ("uv", "by"), [(INSTALLER, "uv"), ("#!/bin/bash\nexit 2\n", "python")], ids=["uv", "pip"]
)
def test_it_installs_once_from_the_locks(checkout, uv, by):
    program(checkout / "uv", uv)
    status, lines, calls = set_up(checkout, by=by)
    assert status == 0 and len(lines) == 2 and "requirements.lock" in lines[1]
    assert [call.split()[-2:] for call in calls] == [
        ["--requirement", "requirements.lock"],
        ["--editable", "."],
    ]
    assert "--require-hashes" in calls[0] and all("--no-deps" in call for call in calls)
    assert set_up(checkout, by=by) == (0, [], [])
    for name in ("dev", "docs", "cluster"):
        status, _, (call,) = set_up(checkout, f"ready_{name}", by)
        assert status == 0 and call.endswith(
            f"--require-hashes --requirement requirements-{name}.lock"
        )
        assert set_up(checkout, f"ready_{name}", by) == (0, [], [])


def test_other_pins_are_installed_and_an_installation_that_failed_is_done_again(checkout):
    (checkout / "status").write_text("1")
    for _ in range(2):
        status, _, calls = set_up(checkout)
        assert status != 0 and len(calls) == 1
    (checkout / "status").write_text("0")
    assert set_up(checkout)[0] == 0
    later = os.stat(checkout / ".venv/installed-run").st_mtime + 10
    os.utime(checkout / "requirements.lock", (later, later))
    assert len(set_up(checkout)[2]) == 2


@pytest.mark.parametrize("says", ["exit 1", "exit 127"], ids=["too old or without venv", "absent"])
def test_a_python_that_will_not_do(checkout, says):
    program(checkout / "fakes" / "python3", f"#!/bin/bash\n{says}\n")
    status, (line,), calls = set_up(checkout)
    assert status != 0 and calls == []
    assert line.startswith("brownpipe: set-up: python3 must be Python >= 3.11 with venv")


def test_cores_are_counted_where_there_is_no_nproc(checkout):
    program(checkout / "fakes" / "nproc", "#!/bin/bash\nexit 127\n")
    surroundings = {"PATH": f"{checkout / 'fakes'}:/usr/bin:/bin", "HOME": str(checkout)}
    command = ["make", "--dry-run", "test"]
    printed = subprocess.check_output(command, cwd=checkout, env=surroundings, text=True)
    assert f"pytest -n {os.cpu_count()} " in printed
