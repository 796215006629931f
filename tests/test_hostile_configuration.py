"""Scene and study files, and --config, that are meant to break something: one short line, soon, and no more memory."""

import json
import os
import re
import time
import tracemalloc
from itertools import pairwise
from pathlib import Path

import pytest

import forked
from brownpipe.errors import RequestError
from brownpipe.quoting import printable
from brownpipe.scene import read_scene
from brownpipe.study import from_command_line, read_study

ROOT = Path(__file__).parent.parent
LONGEST = 400  # characters of a message, with the list of all keys, without the path
SCENE = """\
# every value in a line of its own

box:
  x: [-3.0, 3.0]
  y:
  - -3.0
  - 3.0
  boundary: reflecting
particles: 150
disks:
  tracer:
    radius: 0.3
    mass: 1.0
  species:
  - name: bath
    count: rest
    radius: 0.1

    mass: 0.4
  -
    name: few
    count: 3
    radius: 0.2
    mass: 2
  placement: random
velocities:
  standard_deviation: 2.0
duration: 1.0
sample_interval: 0.01
equilibrate:
  time: 0.5
  tracer: pinned
"""
STUDY = """\
scenes:
- scene.yaml
particles: [50, 150]
engines:
- exact
-
  name: timestep
  time_step: 0.001
  seeds: 3
batch: 30
record: tracer
average: runs
observables:
- pair_distribution
figures:
- msd
displacement_times:
- 0.5
fit_windows:
- [0.1, 1]
-
  [0.2, 0.9]
rings:
  dr: 0.1
  count: 20
tolerance: 2%
observable: msd
"""
WRONG = ("[[]]", "{no: 1}", "-1", "'!'", "null, no")  # none of which any key takes
BOMB = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in pairwise("abcdefghi"))


def refused(path, read):
    """The refusal of a file, without its name; None if it is accepted."""
    before = time.process_time()
    try:
        read(path)
        line = None
    except RequestError as refusal:
        line = str(refusal)
        assert printable(line) == line
        assert len(line) < LONGEST + 2 * len(str(path)), line
        line = line.replace(printable(path), "FILE")
    assert time.process_time() - before < 5, "seconds"
    return line


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    (tmp_path / "study.yaml").write_text(STUDY)
    return tmp_path


@pytest.mark.promise(
    "a wrong value somewhere in a long file",
    "A refusal names the file, the line, the key, the value and what is allowed.",
)
@pytest.mark.parametrize(("name", "read"), [("scene.yaml", read_scene), ("study.yaml", read_study)])
def test_the_line_is_that_of_the_value(folder, capsys, name, read):
    path = folder / name
    assert refused(path, read) is None
    lines = path.read_text().splitlines()
    for number, line in enumerate(lines, 1):
        value = re.fullmatch(r"( *(?:- )?(?:\w+: )?)([^ #].*)", line)
        if value is None or value[2].endswith(":") or value[2] == "-":
            continue
        messages = []
        for wrong in WRONG:
            path.write_text("\n".join([*lines[: number - 1], value[1] + wrong, *lines[number:]]) + "\n")
            messages.append(refused(path, read))
        assert all(message is None or message.startswith(f"FILE: line {number}: ") for message in messages), messages
        assert messages.count(None) <= 1, line  # a name may be null


@pytest.mark.parametrize(("name", "read"), [("scene.yaml", read_scene), ("study.yaml", read_study)])
def test_the_line_of_an_unknown_key_is_its_own_and_of_a_missing_one_that_of_its_mapping(folder, name, read):
    path = folder / name
    lines = path.read_text().splitlines()
    keys = [(number, line) for number, line in enumerate(lines, 1) if re.match(r" *(- )?\w+:", line)]
    for number, line in keys:
        path.write_text("\n".join([*lines[: number - 1], re.sub(r"\w+:", "wrong:", line, count=1), *lines[number:]]))
        expected = "name: missing" if "name: timestep" in line else "unknown key 'wrong'"
        assert re.match(rf"FILE: line {number}: .*{expected}", refused(path, read)), line
    path.write_text("\n".join(line for line in lines if "radius: 0.3" not in line and "time_step" not in line))
    place = {"scene.yaml": "line 11: disks.tracer.radius", "study.yaml": "line 7: engines[1].time_step"}[name]
    assert refused(path, read) == f"FILE: {place}: missing; must be given"


def test_a_value_of_the_command_line_has_no_line(folder):
    path = folder / "study.yaml"
    with pytest.raises(RequestError, match=r"study.yaml with batch replaced: batch: must be an integer"):
        read_study(path, {"batch": -1})
    path.write_text(STUDY.replace("tracer", "trace"))
    with pytest.raises(RequestError, match=r"study.yaml with batch replaced: line 11: record: 'trace' is unknown"):
        read_study(path, {"batch": 3})
    path.write_text(STUDY.replace("observable: msd", "observable: mds"))
    with pytest.raises(RequestError, match=r"study.yaml: line 27: target: 'mds' is unknown"):
        read_study(path)


def broken(random, text):
    """A text with something in it that a reader may stumble over."""
    place = random.choice([match.span() for match in re.finditer(r"[^\s:,\[\]{}]+", text)])
    deep = random.choice([11, 1000, 100_000])
    piece = random.choice(
        [
            "[" * deep,
            "[" * deep + "]" * deep,
            "{a: " * deep,
            "- " * deep,
            "!!python/object/apply:os.system ['true']",
            "&a [*a]",
            "*a",
            "<<: {a: 1}",
            "2001-01-01",
            "12:30:45",
            "9" * random.choice([20, 400, 50_000]),
            "0x" + "f" * random.choice([10, 400]),
            "-.inf",
            ".nan",
            "1e-999",
            "1e309",
            "NO",
            "\t",
            "\x00",
            "\x1b[2J",
            "\ud800",
            "\u202e",
            "'" * random.choice([1, 2, 3]),
            "| \n  a\n",
            "%YAML 1.1\n---\n",
            "? [a]\n: b\n",
            json.dumps("\x1b\n\u2028 curl"),
            '"\\x1b\\L\\P\\N\\_"',
            "x" * 100_000,
            "1," * 50_000,
            "{" + "a: 1, " * 1000 + "}",
            "{" + ", ".join(f"k{i}: 1" for i in range(3000)) + "}",
        ]
    )
    return text[: place[0]] + piece + text[random.choice(place) :]


def mangled(random, text):
    """The bytes of a file with a hostile encoding, with bytes changed, cut, repeated or exchanged."""
    data = bytearray(text.encode(random.choice(["utf-8"] * 8 + ["utf-16", "utf-32", "utf-7"]), errors="surrogatepass"))
    for _ in range(random.choice([0, 0, 1, 3])):
        data[random.randrange(len(data))] = random.randrange(256)
    start, end = sorted(random.sample(range(len(data)), 2))
    cut = random.choice(["none", "none", "end", "out", "twice", "bomb"])
    changes = {"none": data, "end": data[:end], "out": data[:start] + data[end:], "twice": data[:end] + data[start:]}
    return bytes(changes.get(cut, BOMB.encode() + data))


@pytest.mark.slow
@pytest.mark.promise(
    "a configuration that is made to break its reader: deep nesting, aliases that multiply, other encodings, binary",
    "It is refused in one line of at most 400 characters and the path, within seconds and some MB of memory.",
)
def test_whatever_is_in_a_file_it_is_refused_in_one_line_or_valid(folder, faults):
    tracemalloc.start()
    try:
        for _ in faults.tries(40):
            name, read = faults.random.choice([("scene.yaml", read_scene), ("study.yaml", read_study)])
            text = (SCENE if read is read_scene else STUDY).replace("tolerance: 2%\nobservable: msd", "seeds: 5")
            for _ in range(faults.random.choice([0, 1, 1, 1, 2])):
                text = broken(faults.random, text)
            path = folder / f"bad_{name}"
            path.write_bytes(mangled(faults.random, text))
            tracemalloc.reset_peak()
            line = refused(path, read)
            assert line is None or "FILE" in line or str(folder / "scene.yaml") in line
            assert tracemalloc.get_traced_memory()[1] < 1e8, "bytes"
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (lambda: shared(10), "--config: engines: more than 100000 values; aliases (*name) are not allowed, "),
        (lambda: deep(50), "--config: engines: nested more than 10 levels deep"),
        (lambda: deep(900), "--config: engines: nested more than 10 levels deep"),
    ],
)
def test_values_of_the_command_line_are_bounded(value, message):
    """Snakemake has read them as YAML by then, with aliases."""
    with pytest.raises(RequestError, match=re.escape(message)):
        from_command_line({"engines": value()})


def shared(levels):
    """A list of 10**levels values, in little memory."""
    value = "x"
    for _ in range(levels):
        value = [value] * 10
    return value


def deep(levels):
    value = "x"
    for _ in range(levels):
        value = [value]
    return value


@pytest.mark.slow
@pytest.mark.promise(
    "a hostile configuration given to Snakemake itself, which would follow its aliases and run Python code in it",
    "`snakemake --configfile` refuses it in the same line as brownpipe, before Snakemake reads it.",
)
@pytest.mark.parametrize(
    ("contents", "message"),
    [
        (100_000 * b"[", "line 1: nested more than 10 levels deep"),
        (BOMB.encode(), "line 1: anchors (&name) and aliases (*name) are not allowed; write the value out"),
        (
            b"seeds: 1\n__use_yte__: true\n__definitions__: [\"open('hit', 'w')\"]\n",
            "line 2: unknown key '__use_yte__'; a study must not have Python code in it",
        ),
    ],
)
def test_snakemake_does_not_read_what_brownpipe_refuses(tmp_path, contents, message):
    name = "-rf $(touch hit)\n\x1b[2J.yaml"
    (tmp_path / name).write_bytes(contents)
    words = ["--snakefile", ROOT / "Snakefile", "--workflow-profile", ROOT / "profiles" / "default", "--cores", "1"]
    done = forked.snakemake(*words, f"--configfile=./{name}", cwd=tmp_path, env=os.environ)
    lines = [line for line in done.printed.splitlines() if not line.startswith("Using ")]
    assert done.returncode == 1
    assert lines == [f"brownpipe: ./-rf $(touch hit)\\n\\x1b[2J.yaml: {message}"]
    assert not (tmp_path / "hit").exists() and not (tmp_path / "results").exists()
