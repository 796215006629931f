"""The page with all results: well-formed, self-contained, and with the dataset's numbers."""

import html
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from time import sleep

import numpy as np
import pytest
from markupsafe import escape
from pandas import DataFrame

from brownpipe import provenance, tradeoff
from brownpipe.analysis import aggregate
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.errors import DONE, WRONG_REQUEST
from brownpipe.figures import origin
from brownpipe.figures.render import Drawing, drawing_of
from brownpipe.figures.style import drawing, grid
from brownpipe.figures.summary import answer
from brownpipe.report import page
from brownpipe.storage.datasets import read_dataset, write_dataset
from ensembles import make_runs, make_scene, study, write

SHOWN = ("msd", "health")
SVG = b'<svg viewBox="0 0 10 20"></svg>'
VOID = {"meta", "img", "link", "br", "hr", "input"}
MOST_BYTES = 5_000_000
RECORD = {"made_by": {"brownpipe_version": "0"}, "dataset": {"sha256": "0" * 64, "made_from": []}}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder with a dataset, two figures and the page, as the workflow makes them."""
    folder = tmp_path_factory.mktemp("results")
    write_dataset(
        folder / "s.nc", aggregate(study(folder, runs=20, failed=(7, 13)), displacement_times=[1.0])
    )
    assert main(words(folder, "figures")) == DONE
    return folder


def words(results, folder, *further):
    """The arguments that draw the dataset of `results`, with the page, into a folder of it."""
    output = results / folder
    files = [str(results / "s.nc"), "--output", str(output), "--page", f"{output}/report.html"]
    said = [
        "--figures",
        ",".join(SHOWN),
        "--title",
        "Two baths",
        "--note",
        "A hot one.\n\nSecond <part>.",
    ]
    return ["figures", *files, *said, "--panel", "scene", *further]


@pytest.fixture(scope="module")
def written(results):
    return (results / "figures" / "report.html").read_text(encoding="utf-8")


class Elements(HTMLParser):
    """Elements with their attributes and text; asserts that every one is closed where it should
    be.
    """

    def __init__(self, text):
        super().__init__()
        self.open, self.found = [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        assert len({name for name, _ in attributes}) == len(attributes), (
            f"an attribute of {tag} is there twice"
        )
        element = (tag, dict(attributes), [])
        self.found.append(element)
        self.open += [element] if tag not in VOID else []

    def handle_endtag(self, tag):
        assert self.open and self.open[-1][0] == tag, f"</{tag}> in {self.open[-1:]}"
        self.open.pop()

    def handle_data(self, data):
        for _, _, text in self.open:
            text.append(data)

    def named(self, *tags):
        return [(attributes, "".join(text)) for tag, attributes, text in self.found if tag in tags]


def check(text):
    """Everything that must be true of any page."""
    elements = Elements(text)
    assert text.startswith("<!DOCTYPE html>\n") and elements.found[0][:2] == (
        "html",
        {"lang": "en"},
    )
    assert (
        len(elements.named("title"))
        == len(elements.named("h1"))
        == len(elements.named("main"))
        == 1
    )
    names = [attributes["id"] for _, attributes, _ in elements.found if "id" in attributes]
    assert len({*names}) == len(names)
    levels = [int(tag[1]) for tag, _, _ in elements.found if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
    assert all(attributes.get("alt") for attributes, _ in elements.named("img"))
    assert all(attributes.get("scope") for attributes, _ in elements.named("th"))
    for _, attributes, _ in elements.found:
        for name in ("src", "href", "action", "data", "poster", "srcset"):
            link = attributes.get(name) or "#"
            assert link.startswith("data:") or link == "#" or link.removeprefix("#") in names, link
    assert not re.search(r"url\(|@import|https?://", text)
    assert len(text.encode()) < MOST_BYTES
    return elements


def test_the_page_is_well_formed_and_loads_nothing(written):
    assert "N = 10, 20; 72 runs" in written  # 18 of 20 in each of four cases
    elements = check(written)
    assert [text for _, text in elements.named("h2")] == [
        "What is simulated",
        "Answer: MSD(t = 1), D, eq. (18)",
        "Figures",
        "Make it again",
    ]
    assert '<p class="setup">Varied: number of disks = 10, 20; described is' in written
    assert (
        elements.named("h1")[0][1] == "Two baths"
        and '<p class="note">Second &lt;part&gt;.</p>' in written
    )
    assert len(elements.named("img")) == len(SHOWN)


@pytest.mark.slow
def test_files_of_the_user_stay(results, tmp_path, capsys, monkeypatch):
    """Those of figures that are not drawn are left alone; in the place of a product they are
    refused.
    """
    monkeypatch.setattr(
        "brownpipe.figures.render.image_bytes", lambda *_: b"Made by brownpipe"
    )  # pictures take 1 s
    words = ["figures", str(results / "s.nc"), "--output", str(tmp_path), "--figures", "health"]
    words += ["--page", str(tmp_path / "report.html")]
    (tmp_path / "msd.csv").write_text("mine, all mine\n")
    for name in ("health.csv", "report.html"):
        (tmp_path / name).write_text("mine, all mine\n")
        assert main(words) == WRONG_REQUEST
        refused = capsys.readouterr().err
        assert refused.startswith(f"brownpipe: {tmp_path / name}: ") and refused.count("\n") == 1
        assert {*os.listdir(tmp_path)} == {name, "msd.csv"}
        assert (
            (tmp_path / name).read_text()
            == (tmp_path / "msd.csv").read_text()
            == "mine, all mine\n"
        )
        (tmp_path / name).unlink()
    assert main(words) == DONE
    assert (tmp_path / "msd.csv").read_text() == "mine, all mine\n"


def test_figures_that_are_not_drawn_again_go(results, tmp_path):
    """Files that the earlier drawing did not list are the user's, and so is a listed one that she
    has replaced.
    """
    shutil.copytree(results / "figures", tmp_path, dirs_exist_ok=True)
    mine = dict.fromkeys(("energy.csv", "diffusion.png", "msd.csv"), "mine, all mine\n")
    mine["diffusion.svg"] = (tmp_path / "msd.svg").read_text()  # brownpipe's, but of another folder
    for name, text in mine.items():
        (tmp_path / name).write_text(text)
    words = ["figures", str(results / "s.nc"), "--output", str(tmp_path), "--figures", "health"]
    assert main(words) == DONE, "its own files are replaced"
    assert {name: (tmp_path / name).read_text() for name in mine} == mine
    assert origin.read_record(tmp_path / "energy.csv") is None, (
        "the record beside it is of other files"
    )
    drawn = json.loads((tmp_path / origin.RECORD).read_text())["files"]
    assert {*os.listdir(tmp_path)} == {*drawn, *mine, origin.RECORD, "report.html"}


def test_the_answer_is_that_of_the_summary(results, written):
    table = written.partition('id="answer"')[2].partition("</table>")[0]
    found = [re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<t[hd][ >].*?</t[hd]>", table)]
    columns = answer(read_dataset(results / "s.nc")).columns
    assert [*map(html.unescape, found)] == [
        cell for row in zip(*columns, strict=True) for cell in row
    ]
    said = (results / "figures" / "summary.txt").read_text().splitlines()
    assert all(html.escape(line) in written for line in said[-8:-2])
    assert "failed and left out" in said[-4] and 'class="warning"' in written


def test_a_figure_has_its_caption_and_its_numbers(written):
    for name in SHOWN:
        title, paragraphs = page.caption_of(name)
        shown = [text for text in paragraphs if not text.startswith("The note ")]
        assert all(str(escape(text)) in written for text in (title, *shown)), (
            "but for what the note found"
        )
        assert not re.search(r"[*`_]{2}|::", title + "".join(paragraphs)), (
            "marks that the page does not know"
        )
    assert len(re.findall(r"The numbers: (\d+) rows", written)) == len(SHOWN)


def test_names_of_others_are_escaped(results, tmp_path):
    """Neither HTML nor control characters get through: in names of scenes, labels, tables, records
    and commands.
    """
    hostile = "</script><img src=x onerror=alert(1)>'\"&\x1b[2J\u202e"
    dataset = read_dataset(results / "s.nc").assign_coords(scene=[hostile, "b"])
    with drawing():
        figure, axes = grid(1, 1, 3, 3)
        axes[0, 0].plot([0, 1], [0, 1], label=hostile.replace("\x1b", ""))
        shown = drawing_of("msd", figure, DataFrame({hostile: [hostile], "b": [1.0]}), {})
    origins = [{"command": hostile, "seeds": hostile}]
    record = {
        "made_by": {"x_version": hostile},
        "dataset": {"sha256": hostile, "made_from": origins},
    }
    made = page.page_of_results(dataset, [shown], record)
    text = made.decode()
    elements = check(text)
    assert len(elements.named("img")) == 1 and "onerror" not in elements.named("img")[0][0]
    assert not re.search("[\x00-\x09\x0b-\x1f\u202e]", text)
    (tmp_path / "x.html").write_bytes(made)
    assert origin.read_record(tmp_path / "x.html") == record


def test_a_long_table_is_cut(results):
    rows = 100_000
    table = DataFrame({"scene": "a", "N": range(rows), "x": np.arange(rows) / 7, "y": np.nan})
    text = page.page_of_results(
        read_dataset(results / "s.nc"), [Drawing("msd", {"svg": SVG}, table)], RECORD
    ).decode()
    assert "the first 400 of 100,000 rows" in text and len(text) < 200_000
    shown = text.partition("The numbers")[2].partition("</table>")[0]
    assert shown.count("<tr>") == 1 + 400 and ">0.142857<" in shown and ">nan<" not in shown


@pytest.mark.slow
def test_the_page_of_a_trade_off(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scenes = [make_scene("full", 20), make_scene("few", 10)]
    exact = [make_runs(scene, range(30)) for scene in scenes]
    langevin = Engine("langevin", (("friction", "enskog"),))
    others = [runs._replace(engine=langevin) for runs in exact]
    files = [write(tmp_path, runs) for runs in (*exact, *others)]
    cost = {"exact": 1e-3, "langevin": 3e-4}
    dataset = tradeoff.measure(files, seconds_per_run=lambda engine, _: cost[engine.name])
    write_dataset("t.nc", dataset)
    command = ["figures", "t.nc", "--output", "figures", "--page", "figures/report.html"]
    assert main([*command, "--note", "What accuracy costs"]) == DONE
    made = {path.name for path in Path("figures").iterdir()}
    pictures = {"tradeoff.png", "tradeoff.svg"}
    tables = {"tradeoff.csv", "summary.csv", "summary.txt"}
    assert made == pictures | tables | {"provenance.json", "report.html"}
    elements = check(Path("figures/report.html").read_text(encoding="utf-8"))
    assert [text for _, text in elements.named("h1")] == [dataset.title]
    headings = [text for _, text in elements.named("h2")]
    assert headings[0] == "What is simulated"
    assert headings[1].startswith("Answer: ms/run, cost, MSD bias, front, ")
    assert headings[2:] == ["Figures", "Make it again"]
    sentences = [text for known, text in elements.named("p") if known.get("class") == "sentence"]
    assert [text.partition(":")[0] for text in sentences] == ["full, N = 20", "few, N = 10"]
    best = ": the expected error of the MSD is smallest with langevin-enskog, for any CPU time."
    assert all(text.endswith(best) for text in sentences)
    (answer_rows, numbers) = [text for _, text in elements.named("table")]
    for rows in (answer_rows, numbers):
        assert all(name in rows for name in ("full", "few", "exact", "langevin-enskog"))
    assert any("What accuracy costs" in text for _, text in elements.named("p"))
    assert not re.search(r"\\[nx]", elements.named("main")[0][1].partition("Scenes, seeds")[0])


# -- on several cores ------------------------------------------------------------------------------

DRAWS_LONG = """\
import os, sys, time
from dataclasses import replace
from brownpipe.cli import main
from brownpipe.figures import health
def draw(cases):
    open(f"drawing.{os.getpid()}", "w").close()
    time.sleep(60)
health.FIGURE = replace(health.FIGURE, draw=draw)
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_signal_ends_drawing_on_several_cores_without_a_trace(results, tmp_path):
    command = [sys.executable, "-c", DRAWS_LONG, *words(results, "ended", "--cores", "2")]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    while not (found := [*tmp_path.iterdir()]):
        assert process.poll() is None
        sleep(0.02)
    process.terminate()
    assert process.communicate(timeout=20)[1] == "brownpipe: terminated\n"
    assert process.returncode == 128 + signal.SIGTERM and not [*(results / "ended").iterdir()]
    with pytest.raises(ProcessLookupError):
        os.kill(int(found[0].suffix[1:]), 0)


# -- style and caption -----------------------------------------------------------------------------


def test_an_edit_of_style_template_or_caption_is_another_source(tmp_path):
    package = shutil.copytree(
        provenance.PACKAGE, tmp_path / "p", ignore=shutil.ignore_patterns("__pycache__")
    )
    digests = []
    for name in (None, "report/page.css", "report/page.html", "figures/tradeoff.rst"):
        if name is not None:
            (package / name).write_text(
                (package / name).read_text(encoding="utf-8") + "\n", encoding="utf-8"
            )
        provenance.source_digest.cache_clear()
        digests.append(provenance.source_digest("figures", folder=package))
    assert len({*digests}) == 4
