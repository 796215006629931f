"""Make .venv or check that it is up to date, by uv if it is installed, otherwise by pip. `make` runs this first.

    python3 workflow/set_up.py          what a study needs
    python3 workflow/set_up.py dev      the same, and what the tests and linters need
    python3 workflow/set_up.py docs     what a study needs, and what the documentation site needs
    python3 workflow/set_up.py cluster  what a study needs, also on a cluster with Slurm

The versions are those of requirements.lock, requirements-dev.lock and so on; a file with another SHA-256 than these
list is refused. Nothing is installed yet when this runs, so it uses the standard library only. A
python3 older than OLDEST can read it, to report that it is too old.
"""

import os
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from zlib import crc32

OLDEST = (3, 11)
PYTHON_HERE = getattr(sys, "_base_executable", None) or sys.executable  # not an environment that may be replaced
ENVIRONMENT = Path(".venv")
PYTHON = str(ENVIRONMENT / "bin" / "python")
LOCKS = {"run": Path("requirements.lock")}
LOCKS |= {name: Path(f"requirements-{name}.lock") for name in ("dev", "docs", "cluster")}

INCOMPLETE = f"{PYTHON_HERE} lacks its module venv or ensurepip (Debian, Ubuntu: sudo apt install python3-venv)"
ALTERED = re.compile(r"(?:DO NOT MATCH THE HASHES.*?|Hash mismatch for `)(\S+==[^\s`]+)", re.DOTALL)
CAUSES = {  # cause: texts in the output of venv, uv or pip that show it; the first match counts
    "the disk is full": ("No space left on device", "os error 28", "Disk quota exceeded"),
    INCOMPLETE: ("ensurepip is not available", "No module named venv", "No module named ensurepip"),
    "a file or folder here cannot be written to": ("Read-only file system", "Permission denied"),
    "no network, or none that leads to the package index": (
        *("NewConnectionError", "ConnectTimeout", "ReadTimeout", "ProxyError", "name resolution", "dns error"),
        *("Connection refused", "Network is unreachable", "error sending request"),
    ),
    "the package index lacks a pinned package": ("No matching distribution", "was not found in", "no version of"),
}


class SetUpError(Exception):
    """The environment cannot be made; the message is one line."""


def main(which="run"):
    """Make or renew the environment if necessary. Return the exit status."""
    try:
        refuse_old_python()
        for name in dict.fromkeys(("run", which)):
            if not is_ready(name):
                set_up(name)
    except SetUpError as error:
        say(error)
        return 1
    except OSError as error:
        say(cause_of([str(error)]))
        return 1
    except KeyboardInterrupt:
        say("interrupted")
        return 130
    return 0


def refuse_old_python():
    if sys.version_info < OLDEST:
        names = [f"python3.{k}" for k in range(20, OLDEST[1] - 1, -1)]
        newer = [name for name in names if runs(name, "-c", "")]
        found = f"{PYTHON_HERE} is {sys.version_info[0]}.{sys.version_info[1]}"
        wanted = f"another one: make study PYTHON={newer[0] if newer else 'python3.12'}"
        raise SetUpError(f"needs python3 >= {OLDEST[0]}.{OLDEST[1]}, and {found}; {wanted}")


def stamp_of(name):
    """Return a file that is written once all is installed, and its contents: the folder and a checksum of the pins."""
    pins = LOCKS[name].read_bytes() + Path("pyproject.toml").read_bytes()
    return ENVIRONMENT / f"installed-{name}", f"{Path.cwd()} {crc32(pins):08x}"


def is_ready(name):
    stamp, contents = stamp_of(name)
    return stamp.exists() and stamp.read_text() == contents and runs(PYTHON, "-c", "")


def runs(*command):
    """Whether a command can be started and succeeds."""
    try:
        return subprocess.call(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) == 0
    except OSError:
        return False


def set_up(name):
    """Install what a lock file pins. If that fails, remove an environment that was made for it."""
    if not os.access(".", os.W_OK):
        raise SetUpError(f"{Path.cwd()} cannot be written to; take a copy of it elsewhere")
    uv = shutil.which("uv")
    wrong = why_useless(uv)
    if wrong:
        say(f"{ENVIRONMENT} {wrong}: made again")
    made_here = wrong or not ENVIRONMENT.exists()
    try:
        if made_here:
            remove()
            make(uv)
        install(name, uv)
    except BaseException:
        if made_here:
            remove()
        raise


def why_useless(uv):
    """Return why the existing environment cannot be used; None if it can, or if there is none."""
    if not os.path.lexists(ENVIRONMENT):
        return None
    if not runs(PYTHON, "-c", f"import sys; sys.exit(sys.version_info < {OLDEST})"):
        return "is broken: its python does not start or is too old"
    stamp, contents = stamp_of("run")
    if stamp.exists() and stamp.read_text().rpartition(" ")[0] != contents.rpartition(" ")[0]:
        return "is of another folder, as this one was moved or copied"
    return None if uv or runs(PYTHON, "-m", "pip", "--version") else "is broken: it has no pip"


def remove():
    if ENVIRONMENT.is_symlink() or ENVIRONMENT.is_file():
        ENVIRONMENT.unlink()
    else:
        shutil.rmtree(ENVIRONMENT, ignore_errors=True)


def make(uv):
    say(f"making {ENVIRONMENT} with {uv or PYTHON_HERE}")
    command = [uv, "venv", "--python", PYTHON_HERE] if uv else [PYTHON_HERE, "-m", "venv"]
    done = subprocess.run([*command, str(ENVIRONMENT)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode:
        raise SetUpError(cause_of(done.stdout.decode(errors="replace").splitlines()))


def install(name, uv):
    """Install the pinned packages, and brownpipe as it lies here.

    The lock files are complete: no dependency has to be resolved. Byte code is compiled when a module is first
    imported, as compiling all modules takes as long as the rest of the installation. With PYTHONDONTWRITEBYTECODE every
    process would compile again, so all modules are compiled here.
    """
    began, lock, installer = time.monotonic(), LOCKS[name], "uv" if uv else "pip"
    count = lock.read_text().count("==")
    if uv:
        command = [uv, "pip", "install", "--python", PYTHON, "--no-deps"]
        command += ["--compile-bytecode"] if sys.dont_write_bytecode else []
    else:
        command = [PYTHON, "-m", "pip", "install", "--no-deps", "--progress-bar", "off", "--disable-pip-version-check"]
        command += ["--use-pep517"] if sys.dont_write_bytecode else ["--use-pep517", "--no-compile"]
    follow(
        [*command, "--require-hashes", "--requirement", str(lock)],
        f"installing {count} packages with {installer}",
        count,
    )
    if name == "run":
        follow([*command, "--no-build-isolation", "--editable", "."], "installing brownpipe itself")
    say(f"{count} packages installed in {time.monotonic() - began:.0f} s")
    stamp, contents = stamp_of(name)
    stamp.write_text(contents)


def follow(command, task, count=None):
    """Run uv or pip and show its progress. Raises SetUpError with the cause in one line if it fails."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "PIP_NO_INPUT": "1"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment)
    lines, over = [], threading.Event()
    watch = threading.Thread(target=show, args=(lines, over, task, count), daemon=True)
    watch.start()
    try:
        for line in process.stdout:
            lines.append(line.decode(errors="replace").rstrip())
        status = process.wait()
    finally:
        process.kill()
        over.set()
        watch.join()
    if status:
        raise SetUpError(cause_of(lines))


def show(lines, over, task, count):
    """Show the progress of uv or pip until `over`: on a terminal every half second, otherwise at each new stage."""
    terminal, began, stage = sys.stderr.isatty(), time.monotonic(), None
    if not terminal:
        say(task)
    while not over.wait(0.5):
        seconds, before = time.monotonic() - began, stage
        stage, left = how_far(lines, count, seconds)
        if terminal:
            still = f", about {left:.0f} s to go" if left else ""
            sys.stderr.write(f"\r\033[Kbrownpipe: set-up: {task}: {stage}, {seconds:.0f} s{still}")
        elif count and stage != before and stage in ("unpacking", "waiting for the network"):
            say(stage)
    if terminal:
        sys.stderr.write("\r\033[K")


def how_far(lines, count, seconds):
    """Return the stage, and the time left [s] if known, assuming that unpacking takes as long as fetching."""
    fetched = sum(line.startswith(("Collecting ", "Requirement already")) for line in lines)
    if any("Retrying (" in line for line in lines[-1:]):
        return "waiting for the network", None
    if any(line.startswith(("Installing collected", "Prepared ")) for line in lines):
        return "unpacking", None
    left = seconds * (2 * count / fetched - 1) if count and fetched > 4 else None
    return f"{fetched} fetched" if fetched else "fetching", left


def cause_of(lines):
    """Return why venv, uv or pip failed, in one line."""
    text = "\n".join(lines)
    if altered := ALTERED.search(text):
        return (
            f"the index offers another file as {altered[1]} than the one pinned: its SHA-256 is none of the lock file"
        )
    for cause, words in CAUSES.items():
        if any(word in text for word in words):
            return cause
    errors = [line for line in lines if line.lower().startswith("error")]
    return (errors + lines[-1:] + ["it failed without a word"])[0]


def say(text):
    sys.stderr.write(f"brownpipe: set-up: {text}\n")


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
