"""`brownpipe compile`: the kernels of a study, compiled once for each kind of processor."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCENE = Path(__file__).parent.parent / "config" / "scenes" / "harrison2020.yaml"
STUDY = "scenes: scene.yaml\nparticles: [20, 30]\nseeds: 2\nengines: [{name: langevin, friction: enskog}]\n"


@pytest.fixture
def folder(tmp_path):
    """A study of the engine whose only kernel takes 0.1 s to compile, and an empty folder for machine code."""
    shutil.copy(SCENE, tmp_path / "scene.yaml")
    (tmp_path / "study.yaml").write_text(STUDY)
    (tmp_path / "code").mkdir(mode=0o700)
    return tmp_path


def said(folder, *words, processor=""):
    """What a command prints, with kernels for a processor."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "code"), "NUMBA_CPU_NAME": processor}
    command = [sys.executable, "-m", "brownpipe", *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.promise(
    "jobs of a study on nodes with different processors and one folder of machine code",
    "A process loads machine code for its own kind of processor only, and compiles if there is none.",
)
def test_kernels_are_compiled_once_for_each_kind_of_processor(folder):
    assert "1 kernel compiled in " in said(folder, "compile", "study.yaml")
    (first,) = folder.glob("code/*/*.nbc")
    code, changed = first.read_bytes(), first.stat().st_mtime_ns
    assert said(folder, "compile", "study.yaml", "--config", "seeds=3") == "all kernels have been compiled before\n"
    engine = ["--engine", "langevin", "--friction", "enskog"]
    assert "compiling" not in said(folder, "simulate", "scene.yaml", "--particles", "30", *engine)
    assert "compiling" in said(folder, "compile", "study.yaml", processor="generic")
    (other,) = {*folder.glob("code/*/*.nbc")} - {first}
    assert (first.read_bytes(), first.stat().st_mtime_ns) == (code, changed) and other.read_bytes() != code
