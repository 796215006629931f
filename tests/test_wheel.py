"""The package as `pip install` leaves it: a first study in an empty folder, with nothing of the
checkout.
"""

import subprocess
import sys
import sysconfig
import zipfile
from importlib.metadata import Distribution, distribution
from pathlib import Path
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement

from brownpipe.report.page import caption_of

ROOT = Path(__file__).parent.parent
BASICS = "/usr/bin:/bin"
SMALLER = {"seeds: 300 ": "seeds: 2 ", "[200, 400]": "20", "# figures: [msd, ": "figures: [msd] # "}
SCENE = ROOT / "config" / "scenes" / "harrison2020.yaml"
WITHOUT_STUDIES = """
import sys
import brownpipe as bp

runs = bp.simulate(sys.argv[1], particles=5, seeds=3)
result = bp.analyse(runs)
bp.plot(result, "msd").savefig("msd.png")
bp.save(result, "result.nc")
"""
pytestmark = pytest.mark.slow


class Installation(NamedTuple):
    """An installed wheel: its environment is not activated."""

    bin: Path
    folder: Path  # an empty one, to work in


def execute(*words, cwd, **more):
    """A command that has ended. It sees nothing of the environment of the tests."""
    environment = {
        "PATH": BASICS,
        "HOME": str(cwd),
        "LC_ALL": "C.UTF-8",
        "OPENBLAS_NUM_THREADS": "1",
    } | more
    return subprocess.run(
        [*map(str, words)], cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )


def run(*words, cwd, **more):
    """What a command printed, which must succeed."""
    done = execute(*words, cwd=cwd, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def unpack(wheel, packages, programs):
    """Install a wheel of Python files alone as pip does: unpacked, with a program for each of its
    entry points; return what it says of itself.

    pip would first have to be installed in the new environment, which takes 3 s of CPU.
    """
    with zipfile.ZipFile(wheel) as files:
        assert not [name for name in files.namelist() if ".data/" in name]
        files.extractall(packages)
    (information,) = packages.glob("brownpipe-*.dist-info")
    package = Distribution.at(information)
    for script in package.entry_points.select(group="console_scripts"):
        program = programs / script.name
        call = f"import sys\nfrom {script.module} import {script.attr}\nsys.exit({script.attr}())\n"
        program.write_text(f"#!{programs / 'python'}\n{call}")
        program.chmod(0o755)
    return package


def requirements(package, extras):
    """Names of the packages that a package needs with these extras, which may need it itself."""
    names = set()
    for line in package.requires or []:
        requirement = Requirement(line)
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            names.add((requirement.name, *sorted(requirement.extras)))
    return names


def needed_packages(package, extra):
    """The packages that pip would install with a package and an extra of it: those of the tests."""
    packages = {}
    seen = set()
    waiting = requirements(package, [extra])
    while waiting:
        name, *extras = needed = waiting.pop()
        seen.add(needed)
        packages[name] = distribution(name)
        waiting |= requirements(packages[name], extras) - seen
    return packages.values()


def install(wheel, folder, extra=""):
    """The wheel in an environment of its own, with what it needs and no other package."""
    environment = folder / "environment"
    run(sys.executable, "-m", "venv", "--without-pip", environment, cwd=folder)
    (site,) = environment.glob("lib/python*/site-packages")
    package = unpack(wheel, site, environment / "bin")
    for needed in needed_packages(package, extra):
        tops = {file.parts[0] for file in needed.files} - {"..", "__pycache__"}
        for top in tops:
            link = site / top
            if not link.exists():
                link.symlink_to(needed.locate_file(top))
    work = folder / "my work"
    work.mkdir()
    return Installation(environment / "bin", work)


@pytest.fixture(scope="session")
def distributions(tmp_path_factory):
    """The folder with the wheel and the source distribution of the checkout."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-d", folder, cwd=ROOT)
    return folder


@pytest.fixture(scope="session")
def wheel(distributions):
    """The wheel of the checkout."""
    (path,) = distributions.glob("*.whl")
    return path


@pytest.fixture(scope="session")
def installed(wheel, tmp_path_factory):
    """The wheel with the extra `study`, as for `pip install 'brownpipe[study]'`."""
    return install(wheel, tmp_path_factory.mktemp("studies"), "study")


@pytest.fixture(scope="session")
def light(wheel, tmp_path_factory):
    """The wheel alone, as for `pip install brownpipe`."""
    return install(wheel, tmp_path_factory.mktemp("light"))


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


def test_without_the_extra_runs_come_to_their_figures(light):
    slowly = {"NUMBA_DISABLE_JIT": "1"}
    run(light.bin / "python", "-c", WITHOUT_STUDIES, SCENE, cwd=light.folder, **slowly)
    words = ["figures", "result.nc", "--figures", "msd", "--output", "figures"]
    run(light.bin / "brownpipe", *words, cwd=light.folder, **slowly)
    assert {"msd.png", "result.nc", "figures"} <= {path.name for path in light.folder.iterdir()}


def test_without_the_extra_a_study_is_refused_before_anything_is_written(light):
    folder = light.folder / "of a study"
    folder.mkdir()
    refusals = [
        execute(light.bin / "brownpipe", *words, cwd=folder)
        for words in (["new", "first"], ["run", "first.yaml"])
    ]
    line = "brownpipe: studies need Snakemake: pip install 'brownpipe[study]'\n"
    assert [(done.returncode, done.stdout, done.stderr) for done in refusals] == [(2, "", line)] * 2
    assert list(folder.iterdir()) == []


def test_the_source_distribution_makes_the_same_wheel(distributions, wheel, tmp_path):
    (source,) = distributions.glob("*.tar.gz")
    run("tar", "-xzf", source, "-C", tmp_path, cwd=tmp_path)
    (folder,) = tmp_path.iterdir()
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path, cwd=folder)
    assert (tmp_path / wheel.name).read_bytes() == wheel.read_bytes()


def test_the_workflow_and_the_examples_in_the_wheel_are_those_of_the_checkout(wheel):
    folders = ("workflow/rules", "workflow/report", "profiles", "config")
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    files = {"Snakefile", *(path.relative_to(ROOT).as_posix() for path in paths)}
    with zipfile.ZipFile(wheel) as archive:
        pipeline = {
            name.removeprefix("brownpipe/pipeline/")
            for name in archive.namelist()
            if "/pipeline/" in name
        }
        assert pipeline == files
        assert all(
            archive.read(f"brownpipe/pipeline/{file}") == (ROOT / file).read_bytes()
            for file in files
        )
