"""YAML as it is read here: the core schema of YAML 1.2, whichever parser PyYAML has. (Refusals: test_faults.py.)"""

from pathlib import Path

import pytest

from brownpipe.scene.yaml_file import read_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1.", 1.0),
        (".5", 0.5),
        ("+12", 12),
        ("0", 0),
        ("-0.0", 0.0),
        ("0x1F", 31),
        ("0o17", 15),
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
    found = read_yaml(path, 2**20)["a"]
    assert found == value
    assert type(found) is type(value)


def test_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_bytes(b"\xef\xbb\xbfa: 1\r\nb: [2,\r\n  3]\r\n")
    assert read_yaml(path, 2**20) == {"a": 1, "b": [2, 3]}


def test_both_parsers_of_pyyaml_read_the_same(monkeypatch):
    folder = Path(__file__).parent / "scenes"
    files = sorted(folder.glob("*.yaml"))
    assert len(files) > 20
    fast = [repr(read_yaml(file, 2**20)) for file in files]
    monkeypatch.setattr("yaml.__with_libyaml__", False)
    assert [repr(read_yaml(file, 2**20)) for file in files] == fast
