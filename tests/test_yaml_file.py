"""YAML as it is read here: the core schema of YAML 1.2, whichever parser PyYAML has."""

from pathlib import Path

import pytest
import yaml

from brownpipe.scene.reading import read_yaml, yaml_text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1.", 1.0),
        (".5", 0.5),
        ("+12", 12),
        ("0", 0),
        ("-0.0", 0.0),
        ("010", 10),
        ("0x1F", "0x1F"),
        ("no", "no"),
        ("on", "on"),
        ("1_000", "1_000"),
        ("1:30", "1:30"),
        ("2020-09-28", "2020-09-28"),
        ("0b1", "0b1"),
        ("'1'", "1"),
        ("nan", "nan"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("[]", []),
        ("{}", {}),
        ('"a\\nb"', "a\nb"),
    ],
)
def test_scalars_are_those_of_yaml_1_2(tmp_path, text, value):
    path = tmp_path / "file.yaml"
    path.write_text(f"a: {text}\n")
    found = read_yaml(path)["a"]
    assert found == value
    assert type(found) is type(value)


OTHERWISE = ["1.", "007", "0x10", "0o17", "0b1", "1_000", "12", "-3", "0"]
OTHERWISE += ["yes", "No", "on", "OFF", "y", "true", "FALSE", "null", "Null", "~", "", ".inf", "-.INF", ".nan", "nan"]
OTHERWISE += ["12:30", "1:30:00", "2020-09-28", "=", "<<", "- a", "a: b", "#", "'", '"', "\\", "é", "😀"]


def test_texts_that_could_be_read_as_something_else_survive_being_written(tmp_path):
    """Such as the names of scenes: they are in quotes where YAML 1.1 or 1.2 has another value."""
    mapping = {"scenes": OTHERWISE, "one": {text: text for text in OTHERWISE}}
    (tmp_path / "study.yaml").write_text(yaml_text(mapping), encoding="utf-8")
    found = read_yaml(tmp_path / "study.yaml")
    assert found["scenes"] == OTHERWISE and [*found["one"].items()] == [*mapping["one"].items()]
    assert yaml.safe_load((tmp_path / "study.yaml").read_text(encoding="utf-8")) == mapping, "as YAML 1.1"


def test_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: [2,\r\n  3]\r\n")
    assert read_yaml(path) == {"a": 1, "b": [2, 3]}


def test_both_parsers_of_pyyaml_read_the_same(monkeypatch):
    folder = Path(__file__).parent / "scenes"
    files = sorted(folder.glob("*.yaml"))
    assert len(files) > 20
    fast = [repr(read_yaml(file)) for file in files]
    monkeypatch.setattr("brownpipe.scene.reading.LOADER", yaml.BaseLoader)
    assert [repr(read_yaml(file)) for file in files] == fast
