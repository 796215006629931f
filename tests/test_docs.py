"""The documentation site: what its generators write is complete, and config/README.md has examples with all keys.

The site itself is built by `make docs`, where a link to nowhere is an error.
"""

import importlib.util
import inspect
import re
import sys
from pathlib import Path

import pytest
import yaml

from brownpipe.analysis.dataset import ALL_COORDINATES, ALL_VARIABLES
from brownpipe.cli import build_parser
from brownpipe.figures.catalogue import FIGURES
from brownpipe.interface import plot, simulate
from brownpipe.observables import ARRAYS, OBSERVABLES, of_tracer
from brownpipe.scene import Scene, read_scene
from brownpipe.storage.layout import MEANING
from brownpipe.study import Study, read_study
from brownpipe.tradeoff.variables import VARIABLES as TRADEOFF_VARIABLES
from brownpipe.verbs import VERBS

ROOT = Path(__file__).parent.parent
sys.path.append(str(ROOT / "docs" / "_ext"))
import gallery  # noqa: E402
import pages  # noqa: E402
import reference  # noqa: E402
from docstrings import with_list  # noqa: E402
from markdown_text import plain  # noqa: E402
from offline import loaded_from_elsewhere  # noqa: E402
from session import DriftError, executed  # noqa: E402

CONFIGURATION = (ROOT / "config" / "README.md").read_text()
KINDS = {"scene": Scene.model_json_schema(), "study": Study.model_json_schema()}
PARTS = KINDS["scene"]["$defs"] | KINDS["study"]["$defs"]


# -- pages ----------------------------------------------------------------------------------------------------------


def test_every_page_of_docs_is_on_the_site_and_in_its_contents():
    assert {f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")} <= set(pages.PAGES.values())
    contents = re.findall(r"^[^<\n]+ <(\w+)>$", (ROOT / pages.PAGES["index"]).read_text(), re.MULTILINE)
    assert sorted(contents) == sorted({*pages.PAGES, "command_line", "files", "gallery"} - {"index"})


def test_links_are_those_of_the_site():
    text, linked = pages.page_of_site("docs/guide.md")
    assert "[config/README.md](configuration.md)" in text
    assert "(../" not in text
    assert linked == {}
    text, linked = pages.page_of_site("README.md")
    assert "(theory.md)" in text and '<img src="files/docs/figures/movie.gif"' in text
    assert linked["files/tests/naive.py"] == ROOT / "tests" / "naive.py"


def test_links_in_code_are_left_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(pages, "ROOT", tmp_path)
    (tmp_path / "README.md").write_text("[a](README.md#b) [folder](.)\n```text\n[a](README.md)\n```\n")
    assert pages.page_of_site("README.md")[0] == "[a](overview.md#b) folder\n```text\n[a](README.md)\n```\n"


# -- the command line -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", VERBS)
def test_the_reference_has_every_argument_of_a_verb_with_its_help(verb):
    section = reference.command_line().partition(f"\n## {verb}\n")[2].partition("\n## ")[0]
    arguments = [action for action in build_parser([verb]).of_verb._actions if action.dest != "help"]
    for action in arguments:
        name = action.option_strings[-1] if action.option_strings else action.metavar
        assert re.search(rf"^`[^\n]*{re.escape(name)}[^\n]*\n: .*{re.escape(plain(action.help[:20]))}", section, re.M)
    assert section.count("\n: ") == len(arguments)


# -- keys -----------------------------------------------------------------------------------------------------------


def keys_of(schema, path=""):
    """The dotted paths of all keys of a schema, `[]` after a list, with their schemas."""
    for part in parts_of(schema):
        for key, inner in part.get("properties", {}).items():
            yield f"{path}{key}", inner
            yield from keys_of(inner, f"{path}{key}.")
        if isinstance(part.get("items"), dict):
            yield from keys_of(part["items"], f"{path.removesuffix('.')}[].")


def parts_of(schema):
    """A schema and its alternatives, each with its reference followed."""
    schema = PARTS[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    return [schema, *(part for key in ("anyOf", "oneOf") for each in schema.get(key, ()) for part in parts_of(each))]


def section(kind):
    """The section of a kind of file, and its first block of YAML."""
    text = CONFIGURATION.partition(f"\n## {kind.capitalize()}\n")[2].partition("\n## ")[0]
    return text, re.search(r"```yaml\n(.*?)```", text, re.DOTALL)[1]


@pytest.mark.parametrize("kind", KINDS)
def test_the_example_has_every_key_and_the_section_every_word(kind):
    """Explicit disks and engines have examples of their own."""
    text, example = section(kind)
    keys = {
        key: inner for key, inner in keys_of(KINDS[kind]) if not key.startswith(("disks[]", "engines.", "engines[]"))
    }
    assert len(keys) > 15
    last = {key.rpartition(".")[2] for key in keys}
    assert [key for key in last if not re.search(rf"\b{key}:", example)] == []
    words = set().union(*map(words_of, keys.values()))
    assert len(words) > 5
    assert [word for word in words if not re.search(rf"\b{word}\b", text)] == []


def test_the_examples_are_valid_and_have_the_defaults(tmp_path):
    for number, block in enumerate(re.findall(r"```yaml\n(.*?)```", section("scene")[0], re.DOTALL)):
        (tmp_path / f"example_{number}.yaml").write_text(block)
        assert read_scene(tmp_path / f"example_{number}.yaml").duration > 0
    (tmp_path / "scenes").symlink_to(ROOT / "config" / "scenes")
    (tmp_path / "example.yaml").write_text(section("study")[1])
    (tmp_path / "least.yaml").write_text("scenes: [scenes/harrison2020.yaml]\nseeds: 1\n")
    example, least = (read_study(tmp_path / f"{name}.yaml") for name in ("example", "least"))
    of_the_note = {
        "scenes",
        "particles",
        "shown_particles",
        "seeds",
        *("title", "note", "panel", "figures"),
        "fit_windows",
        "displacement_times",
        "rings",
    }
    for key in Study.model_fields.keys() - of_the_note:
        assert getattr(example, key) == getattr(least, key), key


def test_the_table_of_observables_has_all_with_their_arrays():
    table = CONFIGURATION.partition("| observable | arrays")[2].partition("\n\n")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", table, re.MULTILINE))
    assert list(rows) == list(OBSERVABLES)
    for name, row in rows.items():
        assert [array for array in [*OBSERVABLES[name].arrays][1:] if f"`{array}`" not in row] == []
    averaged = section("study")[0].partition("The `average` of ")[2].partition(" can only ")[0]
    assert set(re.findall(r"`(\w+)`", averaged)) == set(of_tracer(OBSERVABLES)[0])


def test_the_docstring_of_plot_has_every_figure():
    assert [name for name in FIGURES if not re.search(rf"\b{name}\b", plot.__doc__)] == []


def words_of(schema):
    """The words that a value may be, also as one of a list."""
    words = set()
    for part in parts_of(schema):
        words |= {word for word in (*part.get("enum", ()), part.get("const")) if isinstance(word, str)}
        words |= words_of(part["items"]) if isinstance(part.get("items"), dict) else set()
    return words


# -- files ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_reference_has_all_that_is_in_files():
    rows = "".join(re.findall(r"^\| .*\n", reference.files(), re.MULTILINE))
    named = set(re.findall(r"`(\w+)`", rows))
    assert MEANING.keys() | ARRAYS.keys() <= named
    for name in (*ALL_VARIABLES, *TRADEOFF_VARIABLES):
        base = next((name.removesuffix(end) for end in reference.ENDINGS if name.endswith(end)), name)
        assert name in named or base in named, name
    assert ALL_COORDINATES.keys() <= named


# -- the gallery ----------------------------------------------------------------------------------------------------


def test_the_gallery_has_every_study_with_a_small_figure():
    text, linked = gallery.page()
    names = sorted(path.stem for path in (ROOT / "config").glob("*.yaml"))
    assert sorted(re.findall(r"^## (\w+)$", text, re.MULTILINE)) == names
    pictures = sorted(gallery.FIGURES.glob("*.png"))
    assert [path.stem for path in pictures] == sorted(gallery.times()) == names
    assert max(path.stat().st_size for path in pictures) <= gallery.MOST_BYTES
    assert all(path.is_file() for path in linked.values())
    assert text.count(" runs in ") == len(names)


def test_the_time_of_a_study_is_that_of_all_its_jobs(elsewhere, monkeypatch):
    monkeypatch.setattr(gallery, "TIMES", Path("times.csv"))
    for job, seconds in (("simulate/s/N6/exact/0-9", 70.25), ("figures/small", 2.5)):
        table = Path(f"results/small/benchmarks/{job}.tsv")
        table.parent.mkdir(parents=True)
        table.write_text(f"s\th:m:s\tmax_rss\n{seconds}\t0:00:00\t-\n")
    Path("times.csv").write_text("cooling,5.0\nsmall,9.0\n")
    gallery.note_time(ROOT / "config" / "small.yaml")
    assert gallery.times() == {"cooling": 5.0, "small": 72.8}


@pytest.mark.slow
def test_figures_of_the_gallery_are_reduced_to_the_same_bytes():
    large = (ROOT / "docs" / "figures" / "msd.png").read_bytes()
    small = gallery.reduced(large)
    assert len(small) < gallery.MOST_BYTES < len(large)
    assert gallery.reduced(large) == small


# -- text -----------------------------------------------------------------------------------------------------------


def test_what_is_no_code_has_no_meaning_for_markdown():
    assert plain("<b> a|b *c* `d|e` x_y\x1b[1m") == r"&lt;b&gt; a\|b \*c\* `d|e` x\_y\\x1b\[1m"


def test_parameters_of_a_docstring_become_a_list():
    lines = inspect.getdoc(simulate).splitlines()
    listed = with_list(lines, inspect.signature(simulate).parameters)
    named = re.findall(r"\*\*(\w+)\*\*", "\n".join(line for line in listed if line.startswith("* ")))
    assert sorted(named) == sorted(inspect.signature(simulate).parameters)
    assert with_list(["Warning: hot"], ["seeds"]) == ["Warning: hot"]


def test_a_session_that_prints_something_else_is_an_error(tmp_path):
    page = "```python\nprint(1)\n```\n\n```text\n{}\n```\n"
    assert executed(page.format(1), tmp_path) == page.format(1)
    with pytest.raises(DriftError, match="prints\n1"):
        executed(page.format(2), tmp_path)


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ('<script src="https://cdn.example/a.js">', ["//cdn.example/a.js"]),
        ("@font-face { src: url('//cdn.example/a.woff') }", ["//cdn.example/a.woff"]),
        ('<a href="https://doi.org/10"> <img src="_images/a.png"> url(a.woff)', []),
    ],
)
def test_what_a_page_would_load_from_elsewhere(text, found):
    assert loaded_from_elsewhere(text) == found


@pytest.mark.skipif(importlib.util.find_spec("latex2mathml") is None, reason="only `make docs` installs latex2mathml")
def test_every_formula_has_mathml():
    from mathml import mathml

    page = (ROOT / "docs" / "theory.md").read_text()
    for formula in re.findall(r"^```math\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        assert mathml(formula, "block").startswith("<math")
    assert "<msup>" not in mathml("v'", "inline") + mathml("v_a'", "inline")
    assert "<munder><mo>" in mathml(r"\left[ \sum_{k} x \right]", "block")
    with pytest.raises(ValueError, match="no MathML"):
        mathml(r"\unknownword x", "inline")


# -- how it is built ------------------------------------------------------------------------------------------------


def test_the_site_is_built_by_make_docs_and_published_from_where_it_writes():
    workflow = yaml.safe_load((ROOT / ".github/workflows/docs.yml").read_text())
    build, publish = workflow["jobs"]["build"]["steps"], workflow["jobs"]["publish"]
    assert [step["run"] for step in build if "run" in step] == ["make docs"]
    recipe = (ROOT / "Makefile").read_text().partition("\ndocs:")[2].partition("\n\n")[0]
    assert f" {build[-1]['with']['path']}\n" in recipe
    assert " -W " in recipe
    assert "refs/heads/main" in publish["if"]
