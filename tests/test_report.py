"""The page with all results: well-formed, self-contained, the same bytes each time, and with the dataset's numbers."""

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
from time import sleep

import numpy as np
import pytest

from brownpipe import provenance, tradeoff
from brownpipe.analysis import aggregate
from brownpipe.cli import main
from brownpipe.engines import Engine
from brownpipe.errors import DONE, WRONG_REQUEST
from brownpipe.figures import origin, render
from brownpipe.figures.drawing import Drawing, drawing_of
from brownpipe.figures.style import drawing, grid
from brownpipe.figures.summary import answer
from brownpipe.figures.tables import Table
from brownpipe.report import page, parts, points, products
from brownpipe.report import study as study_page
from brownpipe.storage import read_dataset, write_dataset
from brownpipe.storage.checksums import digest_of, read_checksums
from ensembles import make_runs, make_scene, study, write
from synthetic import with_measures

SHOWN = ("msd", "health")
VOID = {"meta", "img", "link", "br", "hr", "input"}
MOST_BYTES = 5_000_000
RECORD = {"made_by": {"brownpipe_version": "0"}, "dataset": {"sha256": "0" * 64, "made_from": []}}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a dataset, three figures and the page, as the workflow makes them, and the drawings by name."""
    folder, drawings = tmp_path_factory.mktemp("results"), {}
    write_dataset(folder / "s.nc", aggregate(study(folder, runs=20, failed=(7, 13))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(products, "figure", lambda one, *_: drawings.update({one.name: one}) or parts.figure(one, *_))
        words = ["figures", str(folder / "s.nc"), "--output", str(folder / "figures"), "--figures", *SHOWN]
        assert main([*words, "--page", str(folder / "report.html")]) == DONE
    return folder, drawings


@pytest.fixture(scope="module")
def results(made):
    return made[0]


@pytest.fixture(scope="module")
def written(results):
    return (results / "report.html").read_text(encoding="utf-8")


class Elements(HTMLParser):
    """Elements with their attributes and text; asserts that every one is closed where it should be."""

    def __init__(self, text):
        super().__init__()
        self.open, self.found = [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        assert len({name for name, _ in attributes}) == len(attributes), f"an attribute of {tag} is there twice"
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
    assert text.startswith("<!DOCTYPE html>\n") and elements.found[0][:2] == ("html", {"lang": "en"})
    assert len(elements.named("title")) == len(elements.named("h1")) == len(elements.named("main")) == 1
    names = [attributes["id"] for _, attributes, _ in elements.found if "id" in attributes]
    assert len({*names}) == len(names)
    levels = [int(tag[1]) for tag, _, _ in elements.found if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1 and all(after <= before + 1 for before, after in pairwise(levels))
    assert all(attributes.get("alt") for attributes, _ in elements.named("img"))
    assert all(attributes.get("scope") for attributes, _ in elements.named("th"))
    for _, attributes, _ in elements.found:
        for name in ("src", "href", "action", "data", "poster", "srcset"):
            link = attributes.get(name) or "#"
            assert link.startswith("data:") or link == "#" or link.removeprefix("#") in names, link
    assert not re.search(r"url\(|@import|https?://", text)
    assert "default-src 'none'" in text
    assert len(text.encode()) < MOST_BYTES
    return elements


def test_the_page_is_well_formed_and_loads_nothing(written):
    elements = check(written)
    assert [text for _, text in elements.named("h2")] == ["Answer", "Figures", "Health of the runs", "Make it again"]
    assert len(elements.named("img")) == len(SHOWN)


@pytest.mark.slow
def test_same_bytes_in_another_folder_and_language(results, tmp_path, monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Kathmandu")
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    words = ["figures", str(results / "s.nc"), "--output", str(tmp_path), "--figures", *SHOWN]
    assert main([*words, "--page", str(tmp_path / "report.html")]) == DONE
    assert (tmp_path / "report.html").read_bytes() == (results / "report.html").read_bytes()


def test_the_page_has_a_checksum_and_says_what_it_was_made_from(results, written):
    assert read_checksums(results / "figures")["../report.html"] == digest_of(results / "report.html")
    record = origin.record_in(written.encode())
    beside = json.loads((results / "figures" / origin.RECORD).read_text())
    assert record.pop("file") == "report.html" and beside.pop("files")
    assert record == beside


def test_the_answer_is_that_of_the_summary(results, written):
    """Word for word; the scene of a group of rows is in a row of its own."""
    table = written.partition('id="answer"')[2].partition("</table>")[0]
    found = [re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<t[hd][ >].*?</t[hd]>", table)]
    dataset = read_dataset(results / "s.nc")
    scenes, *columns = answer(dataset).columns
    assert [*map(html.unescape, found)][2:] == [
        *(heading for heading, *_ in columns),
        *(cell for k, row in enumerate(zip(*columns, strict=True)) if k for cell in (*_new(scenes, k), *row)),
    ]
    said = (results / "figures" / "summary.txt").read_text().splitlines()
    assert all(html.escape(line) in written for line in said[-8:-2])
    assert "failed and left out" in said[-4] and 'class="warning"' in written
    assert written.count(html.escape(said[-4])) == 1, "the section on health links to the answer"


def _new(scenes, k):
    return (scenes[k],) if scenes[k] != scenes[k - 1] else ()


def test_a_figure_has_its_caption_and_its_numbers(written):
    for name in SHOWN:
        title, paragraphs = parts.caption_of(name)
        assert all(html.escape(text) in written for text in (title, *paragraphs))
        assert not re.search(r"[*`_]{2}|::", title + "".join(paragraphs)), "marks that the page does not know"
    tables = re.findall(r"The numbers: (\d+) rows", written)
    assert len(tables) == len(SHOWN)


def test_a_replay_stands_after_the_answer(results):
    dataset = read_dataset(results / "s.nc")
    made = study_page.page(dataset, {}, RECORD, "x.html", "<p>replayed</p>").decode()
    assert made.index('id="answer"') < made.index("<p>replayed</p>") < made.index('id="runs"')


def test_names_of_others_are_escaped(results):
    """Neither HTML nor control characters get through: in names of scenes, labels, tables, records and commands."""
    hostile = "</script><img src=x onerror=alert(1)>'\"&\x1b[2J\u202e"
    dataset = read_dataset(results / "s.nc").assign_coords(scene=[hostile, "b"])
    with drawing():
        figure, axes = grid(1, 1, 3, 3)
        axes[0, 0].plot([0, 1], [0, 1], label=hostile.replace("\x1b", ""))
        shown = drawing_of("msd", figure, Table((hostile, "b"), [(hostile, 1.0)]))
    origins = [{"command": hostile, "seeds": hostile}]
    record = {"made_by": {"x_version": hostile}, "dataset": {"sha256": hostile, "made_from": origins}}
    name = f"{hostile}.html"
    figures = {shown.name: parts.figure(shown, shown.name)}
    text = origin.stamped(study_page.page(dataset, figures, record, name), name, record).decode()
    elements = check(text)
    assert len(elements.named("img")) == 1 and "onerror" not in elements.named("img")[0][0]
    assert not re.search("[\x00-\x09\x0b-\x1f\u202e]", text)
    assert origin.record_in(text.encode()) == {"file": name} | record


def test_a_long_table_is_cut(tmp_path):
    rows = [(f"scene {k}", k, k / 7, float("nan")) for k in range(100_000)]
    text = parts.numbers(Table(("scene", "N", "x", "y"), rows), "x")
    assert f"the first {parts.MOST_ROWS} of 100,000 rows" in text and len(text) < 100_000
    assert text.count("<tr>") == 1 + parts.MOST_ROWS and "<td" in text and ">0.142857<" in text and ">nan<" not in text


def test_a_page_needs_the_suffix_of_one(results, capsys):
    words = ["figures", str(results / "s.nc"), "--output", "figures", "--page", "report.pdf"]
    assert main(words) == WRONG_REQUEST
    assert capsys.readouterr().err == "brownpipe: report.pdf: the output must end in .html, not '.pdf'\n"


@pytest.mark.slow
def test_the_page_of_a_trade_off(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exact = make_runs(make_scene("full"), range(30))
    other = exact._replace(engine=Engine("langevin", (("friction", "enskog"),)))
    cost = {"exact": 1e-3, "langevin": 3e-4}
    files = [write(tmp_path, exact), write(tmp_path, other)]
    write_dataset("t.nc", tradeoff.measure(files, seconds_per_run=lambda engine, _: cost[engine.name]))
    assert main(["figures", "t.nc", "--output", "figures", "--page", "figures/report.html"]) == DONE
    elements = check((tmp_path / "figures/report.html").read_text(encoding="utf-8"))
    assert [text for _, text in elements.named("h2")] == ["Answer", "Figures", "Make it again"]
    assert not re.search(r"\\[nx]", elements.named("main")[0][1].partition("Scenes, seeds")[0])
    assert read_checksums("figures")["report.html"] == digest_of("figures/report.html")
    shown = next(json.loads(text) for attributes, text in elements.named("script") if attributes.keys() == {"type"})
    assert {series["name"] for series in shown["panels"][0]["series"]} == {"exact", "langevin-enskog"}
    assert main(["inspect", "figures/report.html", "--reproduce"]) == DONE


# -- on several cores -----------------------------------------------------------------------------------------------

DRAWS_LONG = """\
import os, sys, time
from brownpipe.cli import main
from brownpipe.figures import health
def draw(cases):
    open(f"drawing.{os.getpid()}", "w").close()
    time.sleep(60)
health.draw = draw
sys.exit(main(sys.argv[1:]))
"""


def words(results, folder, *further):
    """The arguments of `made`, with another folder beside that one."""
    figures = ["figures", str(results / "s.nc"), "--output", str(results / folder), "--figures", *SHOWN]
    return [*figures, "--page", str(results / folder / "report.html"), *further]


@pytest.mark.slow
def test_figures_drawn_at_the_same_time_are_the_same(results):
    folders = [results / f"{cores}_cores" for cores in (1, 2)]
    for cores, folder in enumerate(folders, 1):
        assert main(words(results, folder.name, "--cores", str(cores))) == DONE
    one, two = ({file.name: file.read_bytes() for file in folder.iterdir()} for folder in folders)
    assert one == two and {"msd.svg", "health.png", "report.html", "SHA256SUMS"} <= one.keys()
    assert one["msd.svg"] == (results / "figures" / "msd.svg").read_bytes()


@pytest.mark.slow
def test_an_error_in_a_figure_is_said_as_on_one_core(results, capsys):
    dataset = read_dataset(results / "s.nc")
    write_dataset(results / "lacking.nc", dataset.drop_vars("worst_overlap"))
    lacking = str(results / "lacking.nc")
    refusal = f"brownpipe: {lacking}: worst_overlap: is missing in the dataset; make it again\n"
    for cores in ("1", "2"):
        arguments = words(results, f"lacking_{cores}", "--cores", cores)
        arguments[1] = lacking
        assert (main(arguments), capsys.readouterr().err) == (WRONG_REQUEST, refusal)
        assert not (results / f"lacking_{cores}" / "msd.svg").exists()
    write_dataset(results / "lacking.nc", dataset.drop_vars("runs"))
    refusal = refusal.replace("worst_overlap", "runs")
    assert (main(["inspect", lacking]), capsys.readouterr().err) == (WRONG_REQUEST, refusal)


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


# -- values under the pointer ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def shown(made):
    return made[1]


def series_of(figure):
    """(panel, series) of all series of a figure."""
    return [(panel, series) for panel in points.points_of(figure)["panels"] for series in panel["series"]]


def test_places_are_those_of_the_markers_in_the_svg(shown):
    """Against matplotlib's own SVG: every point of the runs on linear axes lies on a marker."""
    one = shown["msd"]
    svg = one.images["svg"].decode()
    markers = np.array([[float(x), float(y)] for x, y in re.findall(r'<use [^>]*x="([0-9.]+)" y="([0-9.]+)"', svg)])
    runs = [line["points"] for panel, line in series_of(one.figure) if "95 % band" in line["name"]]
    assert len(runs) == 4 and len(runs[0]) == 21
    for place in (np.array(point[:2]) for point in runs[0] + runs[1]):
        assert np.abs(markers - place).max(axis=1).min() < 0.06  # places have one decimal
    size = re.search(r'viewBox="0 0 (\S+) (\S+)"', svg).groups()
    assert points.points_of(one.figure)["size"] == [*map(float, size)]


def test_values_and_intervals_are_those_of_the_dataset(shown, results):
    dataset = read_dataset(results / "s.nc").sel(particles=20, engine="exact")
    found = [(panel, line) for panel, line in series_of(shown["msd"].figure) if "95 % band" in line["name"]]
    assert len(found) == 4  # two scenes, on linear and on logarithmic axes
    for panel, line in found:
        case = dataset.sel(scene=panel["title"].partition(",")[0])
        assert panel["x"] == "time t" and "\u27e8r\u00b2\u27e9" in panel["y"] and len(line["points"]) > 5
        for _, _, time, msd, *interval in line["points"]:
            at_time = case.sel(time=time, method="nearest")
            wanted = [float(at_time[name]) for name in ("msd", "msd_low", "msd_high")]
            assert np.allclose([msd, *(interval or wanted[1:])], wanted, rtol=1e-4), (panel, time)
            assert interval or time == 0


def laid_out(dataset, name):
    """A figure as it is when its pictures are made."""
    (one,) = [Drawing(name, render.draw(dataset, name), {}, Table((), []))]
    with drawing():
        one.figure.draw_without_rendering()
    return one.figure


@pytest.mark.slow
@pytest.mark.parametrize("name", ["particle_counts", "thermodynamics", "pair_distribution", "velocity_distribution"])
def test_every_point_is_where_its_values_are(name, results, monkeypatch):
    """The transform of the axes takes x and y, or the place of a shifted marker, to the place; no marks of formulae."""
    monkeypatch.setattr(points, "MOST_POINTS", 300)
    figure = laid_out(with_measures(read_dataset(results / "s.nc")), name)
    panels = points.points_of(figure)["panels"]
    axes = [one for one in figure.axes if one.get_visible()]
    assert 0 < sum(len(line["points"]) for panel in panels for line in panel["series"]) <= 300
    shifted = {"particle_counts": "windows", "thermodynamics": "shifted"}.get(name)
    for panel in panels:
        assert panel["y"] and not re.search(r"[\\${}]", panel["x"] + panel["y"] + panel["title"])
        for line in panel["series"]:
            assert line["name"] and not re.search(r"[\\${}]", line["name"])
            for x, y, *values in line["points"]:
                exact = [one.transData.transform(values[:2]) * 72 / figure.dpi for one in axes]
                off = np.abs(np.array(exact) - [x, figure.get_figheight() * 72 - y])
                near = off[:, 1] < 0.15 if shifted and shifted in panel["x"] else off.max(axis=1) < 0.15
                assert near.any(), (panel["title"], line["name"], values)
                if len(values) == 4:
                    assert values[2] <= values[1] <= values[3]
    if name == "particle_counts":
        assert {point[2] for line in panels[1]["series"] for point in line["points"]} == {10, 20}


def test_rows_of_the_health_figure_have_names(shown):
    found = series_of(shown["health"].figure)
    assert {line["name"] for _, line in found} == {"all runs", "central 90 % of the runs", "median"}
    assert {point[3] for _, line in found for point in line["points"]} == {
        f"{scene}, N = {n}" for scene in ("hot", "thermal") for n in (10, 20)
    }


# -- style and script -----------------------------------------------------------------------------------------------


def test_an_edit_of_style_script_or_caption_is_another_source(tmp_path):
    package = shutil.copytree(provenance.PACKAGE, tmp_path / "p", ignore=shutil.ignore_patterns("__pycache__"))
    digests = []
    for name in (None, "report/page.css", "report/page.js", "figures/tradeoff.rst"):
        if name is not None:
            (package / name).write_text((package / name).read_text(encoding="utf-8") + "\n", encoding="utf-8")
        digests.append([provenance.source_digest(*provenance.STEPS[step], folder=package) for step in STEPS])
    assert all(len({digest[k] for digest in digests}) == 4 for k in range(len(STEPS)))


STEPS = ("figures", "tradeoff_figures")


def luminance(colour):
    """Relative luminance of #rrggbb, as the Web Content Accessibility Guidelines define it."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return sum(weight * part for weight, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_text_has_enough_contrast(scheme):
    block = re.findall(r":root \{([^}]*)\}", page.STYLE.read_text())[scheme]
    colours = dict(re.findall(r"--([\w-]+): (#\w{6})", block))
    on = {"ground": ("ink", "soft", "link"), "card": ("ink", "soft"), "warning": ("ink",), "tip": ("tip-ink",)}
    for ground, inks in on.items():
        for ink in inks:
            low, high = sorted(luminance(colours[name]) for name in (ground, ink))
            assert (high + 0.05) / (low + 0.05) >= 4.5, (ground, ink)


KEYS = """<script>addEventListener("load", () => {
  const plot = document.querySelector(".plot");
  plot.focus();
  const said = ["ArrowRight", "ArrowRight", "End", "Escape"].map(key => {
    plot.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
    return plot.querySelector(".value").textContent;
  });
  const box = plot.getBoundingClientRect(), data = JSON.parse(plot.querySelector("script").textContent);
  const [x, y] = data.panels[0].series[0].points[3];
  plot.dispatchEvent(new PointerEvent("pointermove", { pointerType: "mouse",
    clientX: box.left + box.width * x / data.size[0], clientY: box.top + box.height * y / data.size[1] }));
  said.push(plot.querySelector(".value").textContent, document.documentElement.scrollWidth <= innerWidth);
  document.body.innerHTML = "<pre id=said></pre>";
  document.querySelector("#said").textContent = JSON.stringify(said);
});</script></body>"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the program chromium")
def test_keys_and_pointer_show_values_in_a_browser(written, tmp_path):
    (tmp_path / "page.html").write_text(written.replace("</body>", KEYS), encoding="utf-8")
    browser = ["chromium", "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/profile"]
    words = [*browser, "--window-size=500,800", "--dump-dom", (tmp_path / "page.html").as_uri()]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True).stdout
    said = json.loads(html.unescape(re.search('<pre id="said">(.*?)</pre>', done, re.DOTALL)[1]))
    (panel, *_) = json.loads(re.search(r'<script type="application/json">(.*?)</script>', written)[1])["panels"]
    first = panel["series"][0]["points"]
    chosen = (first[0], first[1], first[-1], first[3])
    for shown, point in zip((*said[:3], said[4]), chosen, strict=True):
        lines = shown.splitlines()
        assert lines[:2] == [panel["series"][0]["name"], panel["title"]]
        assert lines[2:4] == [f"{panel['x']} = {point[2]}", f"{panel['y']} = {point[3]}"]
        assert lines[4:] == (["95 % interval {} to {}".format(*point[4:])] if point[4:] else [])
    assert said[3] == "" and said[5] is True, "nothing is wider than the window"


def test_labels_lose_the_marks_of_formulae_and_nothing_else():
    assert (
        points.plain("dense_250, N = 250: $r^2 / \\sqrt{t}$, $D_0$")
        == "dense_250, N = 250: r\u00b2 / \u221a(t), D\u2080"
    )
