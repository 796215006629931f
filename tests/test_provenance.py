"""What every product says it was made from."""

import getpass
import json
import platform
import re
import socket
import subprocess
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.errors import DONE, WRONG_REQUEST
from brownpipe.figures import origin
from brownpipe.provenance import PACKAGE
from brownpipe.scene import parse_scene
from brownpipe.storage.configurations import read_scene
from brownpipe.storage.datasets import commit_of, read_dataset
from brownpipe.storage.files import seal_of
from brownpipe.storage.trajectories import read_trajectories

pytestmark = pytest.mark.slow

SCENE = Path(__file__).parent.parent / "config" / "scenes" / "harrison2020.yaml"
CASE = "results/s/simulate/harrison2020/N10/exact"
NAMES = ("msd.png", "msd.svg", "msd.csv", "summary.csv", "summary.txt", "provenance.json")
PAGE = "results/s/report.html"
PRODUCTS = ("results/s/aggregate/s.nc", *(f"results/s/figures/{name}" for name in NAMES), PAGE)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study of 20 runs with one figure and a page, in the folders of `brownpipe run`."""
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for seeds in ("0-11", "12-19"):
            simulate = ["simulate", str(SCENE), "--particles", "10", "--seeds", seeds]
            assert main([*simulate, "--output", f"{CASE}/{seeds}.h5"]) == DONE
        files = map(str, Path(CASE).iterdir())
        analysis = [
            "--fit-windows",
            "0.1:1",
            "--ring-width",
            "0.3",
            "--rings",
            "7",
            "--displacement-times",
            "0.4,0.7",
        ]
        assert main(["aggregate", *files, "--output", PRODUCTS[0], *analysis]) == DONE
        words = ["--output", "results/s/figures", "--figures", "msd", "--page", PAGE]
        assert main(["figures", PRODUCTS[0], *words]) == DONE
    return folder


# -- what a product says ---------------------------------------------------------------------------


def test_a_dataset_has_scenes_seeds_engines_options_and_installation(finished):
    attributes = read_dataset(finished / PRODUCTS[0]).attrs
    (entry,) = json.loads(attributes["made_from"])
    assert parse_scene(entry["scene"], "harrison2020.yaml") == read_scene(SCENE, 10)
    assert entry["source_digest"] == read_trajectories(finished / CASE / "0-11.h5").source
    assert (
        entry["command"]
        == "brownpipe simulate harrison2020.yaml --particles 10 --seeds 0-19 --engine exact"
    )
    options = {
        "fit_windows": [[0.1, 1.0]],
        "ring_width": 0.3,
        "rings": 7,
        "displacement_times": [0.4, 0.7],
    }
    assert json.loads(attributes["options"]) == options
    assert attributes["python"] == platform.python_version() and attributes["scipy_version"]


def test_figures_tables_summary_and_page_say_what_their_dataset_says(finished, capsys):
    attributes = read_dataset(finished / PRODUCTS[0]).attrs
    folder = finished / "results/s/figures"
    records = {name: origin.read_record(folder / name) for name in (*NAMES, "../report.html")}
    for name, record in records.items():
        assert record | {"files": []} == records["msd.csv"] | {"files": []}
        assert record["dataset"]["sha256"] == seal_of(finished / PRODUCTS[0])
        assert record["dataset"]["made_from"] == json.loads(attributes["made_from"])
        assert record["dataset"]["options"] == json.loads(attributes["options"])
        assert record["figures"] == ["msd"] and "particles" not in record
        assert record["made_by"]["matplotlib_version"] and record["made_by"]["python"]
        assert main(["inspect", str(folder / name)]) == DONE
        command = "brownpipe simulate harrison2020.yaml --particles 10 --seeds 0-19 --engine exact"
        assert f"runs         {command}\nscenes       are in" in capsys.readouterr().out
    assert records["msd.csv"]["files"] == sorted(set(NAMES) - {"provenance.json"})
    made, where = (folder / "summary.txt").read_text().splitlines()[-2:]
    assert made.startswith("Made by brownpipe ") and where.endswith("provenance.json")


@pytest.mark.parametrize("product", PRODUCTS)
def test_products_name_no_machine_user_folder_or_date(product, finished):
    contents = (finished / product).read_bytes()
    private = {
        str(finished),
        str(Path.home()),
        socket.gethostname(),
        str(SCENE.parent),
        f"/{getpass.getuser()}/",
    }
    assert [word for word in private if len(word) > 3 and word.encode() in contents] == []
    assert not re.search(rb'"?(date|time_stamp|created)"?[=:]', contents, re.IGNORECASE)


def test_movies_and_exports_say_how_their_run_is_made_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    simulate = ["simulate", str(SCENE), "--particles", "3", "--record", "all", "--seeds"]
    assert (
        main([*simulate, "4-5"]) == DONE and main([*simulate, "6"]) == WRONG_REQUEST
    )  # the file is there
    command = (
        "brownpipe simulate harrison2020.yaml --particles 3 --seeds 5 --engine exact --record all"
    )
    for name in ("m.gif", "m.png"):
        assert (
            main(["movie", "harrison2020.h5", "--seed", "5", "--frames", "2", "--output", name])
            == DONE
        )
        assert origin.read_record(name)["movie"] == {"seed": 5, "frames": 2, "fps": 25.0}
        capsys.readouterr()
        assert (
            main(["inspect", name]) == DONE
            and f"runs         {command}\nscenes       " in capsys.readouterr().out
        )
    assert main(["export", "harrison2020.h5", "--seed", "5", "--to", "xyz"]) == DONE
    assert Path("harrison2020.xyz").read_text().count(f'command="{command}"') == 1


def test_the_commit_of_a_checkout_and_whether_it_was_modified(tmp_path, monkeypatch):
    def git(*words):
        command = [
            "git",
            "-c",
            "user.name=a",
            "-c",
            "user.email=b",
            "-c",
            "init.defaultBranch=main",
            *words,
        ]
        return subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.strip()

    package = tmp_path / "src" / PACKAGE.name
    package.mkdir(parents=True)
    (package / "a.py").write_text("1\n")
    assert commit_of(package) == ""
    git("init")
    assert commit_of(package) == ""  # no commit yet
    git("add", "src")
    git("commit", "-m", "one")
    commit = git("rev-parse", "HEAD")
    assert commit_of(package) == commit
    (package / "a.py").write_text("2\n")
    assert commit_of(package) == f"{commit}, modified"
    inside = (
        tmp_path / ".venv" / "lib" / PACKAGE.name
    )  # installed in a folder that somebody keeps in git
    inside.mkdir(parents=True)
    assert commit_of(inside) == ""
    monkeypatch.setenv("PATH", "")
    assert commit_of(package) == ""
