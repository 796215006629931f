"""The package as `pip install` leaves it: a first study in an empty folder, with nothing of the
checkout.
"""

import subprocess
import sys
import sysconfig
import zipfile
from importlib.metadata import Distribution
from pathlib import Path
from typing import NamedTuple

import pytest

from brownpipe.report.page import caption_of

ROOT = Path(__file__).parent.parent
BASICS = "/usr/bin:/bin"
SMALLER = {"seeds: 300 ": "seeds: 2 ", "[200, 400]": "20", "# figures: [msd, ": "figures: [msd] # "}
pytestmark = pytest.mark.slow


class Installation(NamedTuple):
    """An installed wheel: its environment is not activated."""

    wheel: Path
    bin: Path
    folder: Path  # an empty one, to work in


def run(*words, cwd, **more):
    """What a command printed. It sees nothing of the environment of the tests."""
    environment = {
        "PATH": BASICS,
        "HOME": str(cwd),
        "LC_ALL": "C.UTF-8",
        "OPENBLAS_NUM_THREADS": "1",
    } | more
    done = subprocess.run(
        [*map(str, words)], cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def install(wheel, packages, programs):
    """Install a wheel of Python files alone as pip does: unpacked, with a program for each of its
    entry points.

    pip would first have to be installed in the new environment, which takes 3 s of CPU.
    """
    with zipfile.ZipFile(wheel) as files:
        assert not [name for name in files.namelist() if ".data/" in name]
        files.extractall(packages)
    (information,) = packages.glob("brownpipe-*.dist-info")
    for script in Distribution.at(information).entry_points.select(group="console_scripts"):
        program = programs / script.name
        call = f"import sys\nfrom {script.module} import {script.attr}\nsys.exit({script.attr}())\n"
        program.write_text(f"#!{programs / 'python'}\n{call}")
        program.chmod(0o755)


@pytest.fixture(scope="session")
def installed(tmp_path_factory):
    """The wheel in an environment of its own, which shares the other packages with that of the
    tests.
    """
    folder = tmp_path_factory.mktemp("wheel")
    run(
        sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder / "wheel", cwd=ROOT
    )  # as `build` does
    (wheel,) = (folder / "wheel").iterdir()
    own = folder / "environment"
    run(sys.executable, "-m", "venv", "--without-pip", own, cwd=folder)
    (packages,) = own.glob("lib/python*/site-packages")
    install(wheel, packages, own / "bin")
    shared = [path for path in sys.path if path.endswith("site-packages")] or [
        sysconfig.get_path("purelib")
    ]
    (packages / "others.pth").write_text("\n".join(shared) + "\n")
    (folder / "my work").mkdir()
    return Installation(wheel, own / "bin", folder / "my work")


@pytest.fixture(scope="session")
def new(installed):
    """What is printed by `brownpipe new`, which writes a first scene and study."""
    return run(installed.bin / "brownpipe", "new", "first", cwd=installed.folder)


@pytest.fixture(scope="session")
def finished(installed, new):
    """What is printed by `brownpipe run` for a first study, here with fewer runs and one figure.

    Its two runs take less time as Python than their kernels take to be compiled.
    """
    study = installed.folder / "first.yaml"
    text = study.read_text()
    for old, other in SMALLER.items():
        assert old in text
        text = text.replace(old, other)
    study.write_text(text)
    return run(
        installed.bin / "brownpipe",
        "run",
        "first.yaml",
        "-j2",
        cwd=installed.folder,
        NUMBA_DISABLE_JIT="1",
    )


def test_a_first_study_comes_to_its_figures(installed, new, finished):
    figures = installed.folder / "results" / "first" / "figures"
    expected = {"msd.svg", "msd.png", "msd.csv", "summary.txt", "summary.csv", "provenance.json"}
    assert {path.name for path in figures.iterdir() if "_from_" not in path.name} == expected
    assert finished.startswith((figures / "summary.txt").read_text())
    visible = {path.name for path in installed.folder.iterdir() if not path.name.startswith(".")}
    assert visible == {"first.yaml", "first_scene.yaml", "results"}
    assert (
        Path(new.rpartition("all keys: ")[2].strip()).read_bytes()
        == (ROOT / "config/README.md").read_bytes()
    )


def test_the_page_is_there_and_the_report_of_snakemake_runs_nothing_again(installed, finished):
    page = finished.rpartition("all on one page: ")[2].strip()
    title, _ = caption_of("msd")
    assert page == "results/first/report.html" and title in (installed.folder / page).read_text(
        encoding="utf-8"
    )
    made = {path: path.stat().st_mtime_ns for path in (installed.folder / "results").rglob("*.*")}
    run(
        installed.bin / "brownpipe",
        "run",
        "first.yaml",
        "--report",
        "report.html",
        cwd=installed.folder,
    )
    report = (installed.folder / "report.html").read_text()
    assert "<svg" in report and title in report
    assert {path: path.stat().st_mtime_ns for path in made} == made


def test_nothing_of_the_checkout_is_used(installed, finished):
    code = (
        "import brownpipe as b, snakemake_logger_plugin_brownpipe as p, sys; print(b.__file__, "
        "p.__file__, *sys.path)"
    )
    shown = run(installed.bin / "python", "-c", code, cwd=installed.folder)
    assert all(path.startswith(str(installed.bin.parent)) for path in shown.split()[:2])
    assert str(ROOT / "src") not in shown
    logs = [path.read_text() for path in (installed.folder / ".snakemake" / "log").iterdir()]
    packages = sysconfig.get_path("purelib")  # of the other programs; may lie in the checkout
    assert logs and all(str(ROOT) not in log.replace(packages, "") for log in logs)


def test_the_workflow_and_the_examples_in_the_wheel_are_those_of_the_checkout(installed):
    folders = ("workflow/rules", "workflow/report", "profiles", "config")
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    files = {"Snakefile", *(path.relative_to(ROOT).as_posix() for path in paths)}
    with zipfile.ZipFile(installed.wheel) as wheel:
        pipeline = {
            name.removeprefix("brownpipe/pipeline/")
            for name in wheel.namelist()
            if "/pipeline/" in name
        }
        assert pipeline == files
        assert all(
            wheel.read(f"brownpipe/pipeline/{file}") == (ROOT / file).read_bytes() for file in files
        )
