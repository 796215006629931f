"""The JSON Schemas of scenes and studies: those of docs/schema, which accept the files that are there."""

import json
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from brownpipe.cli import main
from brownpipe.errors import DONE
from brownpipe.scene.reading import read_yaml

ROOT = Path(__file__).parent.parent
SCENES = [*(ROOT / "config" / "scenes").glob("*.yaml"), *(ROOT / "tests" / "scenes").glob("*.yaml")]
ACCEPTED = {
    "scene": [file for file in SCENES if not file.stem.startswith(("refuse_", "expected"))],
    "study": [*(ROOT / "config").glob("*.yaml")],
}


@pytest.mark.parametrize("kind", ACCEPTED)
def test_the_schema_is_in_docs_and_accepts_all_files(kind, capsys):
    assert main(["schema", kind]) == DONE
    printed = capsys.readouterr().out
    assert (ROOT / "docs" / "schema" / f"{kind}.json").read_text() == printed, (
        f"brownpipe schema {kind} > docs/schema/{kind}.json"
    )
    Draft202012Validator.check_schema(json.loads(printed))
    accepts = Draft202012Validator(json.loads(printed)).is_valid
    assert [file for file in ACCEPTED[kind] if not accepts(read_yaml(file))] == []
    assert not accepts({}) and not accepts(read_yaml(ACCEPTED[kind][0]) | {"wrong": 1})
