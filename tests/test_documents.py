"""What the documents show works: commands, snippets, examples with all keys; links and files
exist.
"""

import inspect
import json
import os
import pkgutil
import re
import shlex
import subprocess
import tomllib
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

import forked
from brownpipe.cli import main
from brownpipe.errors import DONE
from brownpipe.observables import OBSERVABLES
from brownpipe.scene import Scene
from brownpipe.scene.reading import read_yaml
from brownpipe.storage.configurations import read_scene
from brownpipe.study import Study, read_study

ROOT = Path(__file__).parent.parent
NAMES = (
    "README.md",
    "CONTRIBUTING.md",
    *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md"))),
)
PAGES = {name: (ROOT / name).read_text() for name in NAMES}
README, GUIDE, CLUSTER = (PAGES[name] for name in ("README.md", "docs/guide.md", "docs/cluster.md"))
CONFIGURATION = (ROOT / "config" / "README.md").read_text()
DATASET = "results/harrison2020/aggregate/harrison2020.nc"


def blocks(language, page):
    return re.findall(rf"^```{language}\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


# -- commands and snippets of README and guide -----------------------------------------------------


def commands(program, page):
    """Lines that begin with a program, in blocks of either kind and in the text; without their
    comments.
    """
    lines = re.findall(rf"^(?:    )?({program} .*)$|`({program} [^`]*)`", page, re.MULTILINE)
    return [
        shlex.split((block or inline).partition("&&")[0], comments=True)[1:]
        for block, inline in lines
    ]


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
        words_of = commands("brownpipe", shown.replace("0-199", "0-19"))
        for words in dict.fromkeys(map(tuple, words_of)):  # some stand on both pages
            fewer = (
                ["--frames", "5"]
                if words[-1].endswith(".gif")
                else ["--figures", "msd"] * (words[0] == "figures")
            )
            assert (
                words[0] == "run" or main([*words, *fewer]) == DONE
            )  # tests/test_wheel.py runs a new study
        assert (
            main(["aggregate", "seed17.h5", "--fit-windows", "0.1:1", "--output", DATASET]) == DONE
        )
    return folder


@pytest.mark.slow
def test_the_scene_of_ones_own_comes_to_its_figures(folder):
    assert {"msd.png", "summary.txt"} <= {path.name for path in (folder / "my_figures").iterdir()}


OF_OURS = [
    page for name, page in PAGES.items() if name != "docs/other_programs.md"
]  # which have a make of their own


@pytest.mark.parametrize(
    "words", [words for page in OF_OURS for words in commands("make", page)], ids=" ".join
)
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
@pytest.mark.parametrize(
    "code", blocks("python", README + GUIDE), ids=lambda code: code.partition("\n")[0]
)
def test_snippets_run(code, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    exec(compile(code, "snippet", "exec"), {})
    out, err = capsys.readouterr()
    assert err == "" and (out or "print" not in code)


# -- keys ------------------------------------------------------------------------------------------

KINDS = {"scene": Scene.model_json_schema(), "study": Study.model_json_schema()}
PARTS = KINDS["scene"]["$defs"] | KINDS["study"]["$defs"]
SCENES = [*(ROOT / "config" / "scenes").glob("*.yaml"), *(ROOT / "tests" / "scenes").glob("*.yaml")]
ACCEPTED = {
    "scene": [file for file in SCENES if not file.stem.startswith(("refuse_", "expected"))],
    "study": [*(ROOT / "config").glob("*.yaml")],
}
OF_THE_NOTE = {
    "scenes",
    "particles",
    "shown_particles",
    "seeds",
    "title",
    "note",
    "panel",
    "figures",
}
OF_THE_NOTE |= {"fit_windows", "displacement_times", "rings"}


@pytest.mark.parametrize("kind", ACCEPTED)
def test_the_schema_is_in_docs_and_accepts_all_files(kind, capsys):
    assert main(["schema", kind]) == DONE
    printed = capsys.readouterr().out
    command = f"brownpipe schema {kind} > docs/schema/{kind}.json"
    assert (ROOT / "docs" / "schema" / f"{kind}.json").read_text() == printed, command
    accepts = Draft202012Validator(json.loads(printed)).is_valid
    assert [file for file in ACCEPTED[kind] if not accepts(read_yaml(file))] == []
    assert not accepts({}) and not accepts(read_yaml(ACCEPTED[kind][0]) | {"wrong": 1})


def keys_of(schema, path=""):
    """The dotted paths of all keys of a schema, `[]` after a list."""
    schema = PARTS[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    for key, inner in schema.get("properties", {}).items():
        yield f"{path}{key}"
        yield from keys_of(inner, f"{path}{key}.")
    if isinstance(schema.get("items"), dict):
        yield from keys_of(schema["items"], f"{path.removesuffix('.')}[].")
    for part in (*schema.get("anyOf", ()), *schema.get("oneOf", ())):
        yield from keys_of(part, path)


def examples(kind):
    """The blocks of YAML in the section of a kind of file; the first has every key."""
    return blocks(
        "yaml", CONFIGURATION.partition(f"\n## {kind.capitalize()}\n")[2].partition("\n## ")[0]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_the_example_has_every_key(kind):
    """Given disks and engines have examples of their own."""
    others = [f"disks{key}" for key in ("[]", ".file", ".seed", ".time", ".push_apart")]
    others += ["disks.configuration", "engines.", "engines[]"]
    keys = [key for key in keys_of(KINDS[kind]) if not key.startswith(tuple(others))]
    assert len(keys) > 15
    last = {key.rpartition(".")[2] for key in keys}
    assert [key for key in last if not re.search(rf"\b{key}:", examples(kind)[0])] == []


def test_the_examples_are_valid_and_have_the_defaults(tmp_path):
    for number, block in enumerate(examples("scene")):
        (tmp_path / f"example_{number}.yaml").write_text(block)
        assert read_scene(tmp_path / f"example_{number}.yaml").duration > 0
    (tmp_path / "scenes").symlink_to(ROOT / "config" / "scenes")
    (tmp_path / "example.yaml").write_text(examples("study")[0])
    (tmp_path / "least.yaml").write_text("scenes: [scenes/harrison2020.yaml]\nseeds: 1\n")
    example, least = (read_study(tmp_path / f"{name}.yaml") for name in ("example", "least"))
    for key in Study.model_fields.keys() - OF_THE_NOTE:
        assert getattr(example, key) == getattr(least, key), key


def test_the_table_of_observables_has_all():
    table = CONFIGURATION.partition("| observable | arrays")[2].partition("\n\n")[0]
    assert re.findall(r"^\| `(\w+)` \| ", table, re.MULTILINE) == list(OBSERVABLES)


# -- links and names -------------------------------------------------------------------------------


def headings(page):
    """The anchors that GitHub makes of a page's headings."""
    text = re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", PAGES)
def test_links_pictures_and_files_named_on_a_page_are_there(page):
    """Files by their path from any folder on; NAME, SCENE and the like stand for names of one's
    own.
    """
    links = re.findall(r"\]\(([^)#: ]*)(?:#([^)]*))?\)", PAGES[page])
    files = [file for file, _ in links] + re.findall(r"<img src=\"([^\"]*)\"", PAGES[page])
    assert [file for file in files if not ((ROOT / page).parent / file).exists()] == []
    for file, anchor in links:
        target = (ROOT / page).parent / file if file else ROOT / page
        assert not anchor or anchor in headings(target.read_text()), f"{file}#{anchor}"
    folders = (
        ROOT / name
        for name in ("src", "workflow", "config", "tests", "benchmarks", "docs", "validation")
    )
    paths = [
        f"/{path.relative_to(ROOT)}"
        for folder in folders
        for path in folder.rglob("*")
        if path.is_file()
    ]
    named = re.findall(r"`([\w./]+\.(?:py|smk|yaml|md))`", PAGES[page])
    assert [
        name
        for name in named
        if not any(path.endswith(f"/{name}") for path in paths) and name.islower()
    ] == []


def test_functions_named_on_the_page_of_equations_exist():
    names = set(
        re.findall(
            r"`((?:analysis|engines|observables|scene|theory)\.[\w.]+)`", PAGES["docs/theory.md"]
        )
    )
    found = {name: pkgutil.resolve_name(f"brownpipe.{name}") for name in names}
    assert found and all(callable(one) and not inspect.isclass(one) for one in found.values())


def test_the_citation_is_of_this_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == project["version"]
