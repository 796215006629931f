"""What the README tells people to type works as it stands there."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from brownpipe.cli import DONE, main

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
DATASET = "results/harrison2020/aggregate/harrison2020.nc"


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder after the commands of the README were run in it."""
    folder = tmp_path_factory.mktemp("readme")
    (folder / "config").symlink_to(ROOT / "config")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in re.findall(r"^brownpipe .*", "".join(blocks("sh")), re.MULTILINE):
            assert main(shlex.split(line, comments=True)[1:]) == DONE
        assert main(["aggregate", "seed17.h5", "--output", DATASET]) == DONE
    return folder


@pytest.mark.parametrize("code", blocks("python"), ids=["h5py", "xarray"])
def test_snippets_run(code, folder):
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout


def test_map_names_every_source_file_in_the_order_of_imports():
    named = re.findall(r"`(\w+)(?:\.py|/)`", README.partition("## Map")[2].partition("## Speed")[0])
    package = ROOT / "src" / "brownpipe"
    there = {path.stem for path in package.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
    assert set(named) >= there - {"__init__", "__main__"}
    for place, name in enumerate(named):
        files = [package / f"{name}.py", *(package / name).rglob("*.py")]
        text = "".join(file.read_text() for file in files if file.exists())
        imported = set(re.findall(r"^from brownpipe(?:\.| import )(\w+)", text, re.MULTILINE)) - {name}
        assert imported <= set(named[:place]), name


def test_links_and_pictures_are_there():
    links = re.findall(r"\]\(([^)#:]+)\)", README)
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []
