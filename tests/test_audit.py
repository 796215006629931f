"""`make audit`: pinned versions against known vulnerabilities, with and without a network. pip-audit is a fake."""

import importlib.util
import json
import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
DATABASE = """\
id: PYSEC-2099-1
aliases: [GHSA-1111, CVE-2099-1]
affected:
- package: {name: Attrs, ecosystem: PyPI}
  ranges:
  - {type: GIT, events: [{introduced: "0"}]}
  - {type: ECOSYSTEM, events: [{introduced: "0"}, {fixed: 1.2}, {introduced: "2.0"}]}
"""


@pytest.fixture
def audit(tmp_path, monkeypatch):
    """The module in a checkout with two pins, and no program on PATH."""
    told = importlib.util.spec_from_file_location("audit", ROOT / "workflow" / "audit.py")
    module = importlib.util.module_from_spec(told)
    told.loader.exec_module(module)
    (tmp_path / "workflow").mkdir()
    (tmp_path / "bin").mkdir()
    (tmp_path / "requirements.lock").write_text("# pins\nAttrs==1.10 \\\n    --hash=sha256:00\nidna==3.7\n")
    (tmp_path / "requirements-dev.lock").write_text("types_x==6.0.1\n")
    (tmp_path / "workflow" / "advisories.txt").write_text("# of 2030-01-02\nidna 0 3.7 CVE-1\nattrs 1.0 1.9.1 CVE-2\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    return module


def pip_audit(text):
    """A pip-audit that prints a text and fails, as it does when it finds something."""
    program = Path("bin/pip-audit")
    program.write_text(f"#!/bin/sh\nprintf '%s' '{text}'\nexit 1\n")
    program.chmod(0o755)


def said(audit, capsys):
    return audit.main(), [line.removeprefix("brownpipe: audit: ") for line in capsys.readouterr().out.splitlines()]


@pytest.mark.promise("known vulnerability", "Without a network the pins are compared with the stored advisories.")
def test_without_a_network_stored_advisories_are_compared(audit, capsys):
    none = "current database: not asked, as there is no pip-audit, uvx or pipx"
    assert said(audit, capsys) == (0, ["3 pinned versions, 2 stored advisories (2030-01-02): none is affected", none])
    with open("workflow/advisories.txt", "a") as file:
        file.write("attrs 1.9 - CVE-3\n")
    status, (first, _) = said(audit, capsys)
    assert (status, first.partition("): ")[2]) == (1, "affected: attrs 1.10: CVE-3")
    pip_audit("no connection")
    assert said(audit, capsys)[1][1] == "current database: not reached by pip-audit; is there a network?"


@pytest.mark.promise("known vulnerability", "Versions that the database does not know are not counted as safe.")
def test_what_the_database_does_not_know_is_not_called_safe(audit, capsys):
    skipped = {"name": "idna", "skip_reason": "not found"}
    found = {"name": "attrs", "version": "1.10", "vulns": [{"id": "PYSEC-7"}]}
    pip_audit(json.dumps({"dependencies": [skipped, {"name": "types-x", "version": "6.0.1", "vulns": []}]}))
    of_these = "current database: 1 of 3 pinned versions found there by pip-audit; none of these is affected"
    assert said(audit, capsys)[1][1:] == [of_these]
    pip_audit(json.dumps({"dependencies": [skipped]}))
    assert said(audit, capsys)[1][1].endswith(
        "0 of 3 pinned versions found there by pip-audit; nothing is known of them"
    )
    pip_audit(json.dumps({"dependencies": [skipped, found]}))
    status, lines = said(audit, capsys)
    assert (status, lines[2]) == (1, "affected: attrs 1.10: PYSEC-7")


def test_the_stored_advisories_come_from_the_database(audit, monkeypatch):
    folder = Path("database/vulns/attrs")
    folder.mkdir(parents=True)
    (folder / "PYSEC-2099-1.yaml").write_text(DATABASE)
    (folder / "PYSEC-2099-2.yaml").write_text(f"withdrawn: 2099-01-01\n{DATABASE}")
    (folder.parent / "other").mkdir()
    git = Path("bin/git")
    git.write_text("#!/bin/sh\necho 0123456, 2099-03-04\n")
    git.chmod(0o755)
    assert audit.main("database") == 0
    date, advisories = audit.read_stored(Path("workflow/advisories.txt").read_text())
    name = "PYSEC-2099-1,CVE-2099-1"
    assert (date, advisories) == ("2099-03-04", [("attrs", "0", "1.2", name), ("attrs", "2.0", "-", name)])
    assert [advisory.affects("1.10") for advisory in advisories] == [False, False]
    assert [advisory.affects("2.1") for advisory in advisories] == [False, True]


def test_the_stored_advisories_of_this_checkout_affect_no_pin(audit, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    assert os.environ["PATH"].endswith("bin")
    status, lines = said(audit, capsys)
    assert status == 0 and lines[0].endswith("none is affected")
