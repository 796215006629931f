"""Commands and snippets of README, guide and docs/cluster.md work as printed; links, headings and files exist."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import forked
from brownpipe.cli import main
from brownpipe.errors import DONE
from test_architecture import LAYERS

ROOT = Path(__file__).parent.parent
NAMES = ("README.md", "CONTRIBUTING.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md"))))
PAGES = {name: (ROOT / name).read_text() for name in NAMES}
README, GUIDE, CLUSTER = (PAGES[name] for name in ("README.md", "docs/guide.md", "docs/cluster.md"))
DATASET = "results/harrison2020/aggregate/harrison2020.nc"


def blocks(language, page):
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


def commands(program, page):
    """Lines that begin with a program, in blocks of either kind and in the text; without their comments."""
    lines = re.findall(rf"^(?:    )?({program} .*)$|`({program} [^`]*)`", page, re.MULTILINE)
    return [shlex.split((block or inline).partition("&&")[0], comments=True)[1:] for block, inline in lines]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder after the commands of the README and of the guide were run in it."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "config").symlink_to(ROOT / "config")
    (scene,) = blocks("yaml", README)
    (folder / "my_scene.yaml").write_text(scene)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        shown = "".join(block for page in (README, GUIDE, CLUSTER) for block in blocks("sh", page))
        given = dict.fromkeys(map(tuple, commands("brownpipe", shown)))  # some stand on both pages
        for words in given:
            assert words[0] == "run" or main([*words]) == DONE  # tests/test_wheel.py runs a new study
        assert main(["aggregate", "seed17.h5", "--fit-windows", "0.1:1", "--output", DATASET]) == DONE
    return folder


def test_the_readme_is_a_front_page():
    assert len(README.splitlines()) <= 120


@pytest.mark.slow
def test_the_scene_of_ones_own_comes_to_its_figures(folder):
    assert {"msd.png", "summary.txt"} <= {path.name for path in (folder / "my_figures").iterdir()}


OF_OURS = [page for name, page in PAGES.items() if name != "docs/other_programs.md"]  # which have a make of their own


@pytest.mark.parametrize("words", [words for page in OF_OURS for words in commands("make", page)], ids=" ".join)
def test_make_knows_its_targets(words):
    done = subprocess.run(["make", "--dry-run", *words], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("words", commands("snakemake", README + GUIDE), ids=" ".join)
def test_snakemake_knows_what_to_do(words, folder):
    """Planned, not run: a study from end to end is in test_workflow.py."""
    words = [word.replace("my_study.yaml", "config/small.yaml") for word in words]
    words = ["--snakefile", ROOT / "Snakefile", *words, "--dry-run", "--quiet", "all"]
    done = forked.snakemake(*words, cwd=folder, env=os.environ)
    assert done.returncode == 0, done.printed


@pytest.mark.slow
@pytest.mark.parametrize("code", blocks("python", README + GUIDE), ids=["brownpipe", "h5py", "xarray", "matplotlib"])
def test_snippets_run(code, folder):
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout or "print" not in code


def test_map_names_every_layer_in_the_order_of_imports():
    """The order itself is held by tests/test_architecture.py."""
    table = PAGES["CONTRIBUTING.md"].partition("\n## Map")[2].partition("\n### ")[0]
    named = re.findall(r"`(\w+)(?:\.py|/)`", table)
    assert [name for name in named if name in LAYERS] == [name for name in LAYERS if name != "__main__"]


def headings(page):
    """The anchors that GitHub makes of a page's headings."""
    text = re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_are_there(page):
    links = re.findall(r"\]\(([^)#: ]*)(?:#([^)]*))?\)", PAGES[page])
    files = [file for file, _ in links] + re.findall(r"<img src=\"([^\"]*)\"", PAGES[page])
    assert any(files) or page == "docs/theory.md"
    assert [file for file in files if not ((ROOT / page).parent / file).exists()] == []
    for file, anchor in links:
        target = (ROOT / page).parent / file if file else ROOT / page
        assert not anchor or anchor in headings(target.read_text()), f"{file}#{anchor}"


@pytest.mark.parametrize("page", PAGES)
def test_files_named_on_a_page_are_there(page):
    """Named by their path from any folder on; NAME, SCENE and the like stand for names of one's own."""
    folders = (ROOT / name for name in ("src", "workflow", "config", "tests", "benchmarks", "docs", "validation"))
    paths = [f"/{path.relative_to(ROOT)}" for folder in folders for path in folder.rglob("*") if path.is_file()]
    named = re.findall(r"`([\w./]+\.(?:py|smk|yaml|md))`", PAGES[page])
    assert [name for name in named if not any(path.endswith(f"/{name}") for path in paths) and name.islower()] == []
