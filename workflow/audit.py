"""Compare the pinned versions with known vulnerabilities: `make audit`.

    python workflow/audit.py            with workflow/advisories.txt and, by pip-audit, with the current database
    python workflow/audit.py DATABASE   write workflow/advisories.txt anew from a clone of pypa/advisory-database

The first works without a network, too, and then says that only the stored advisories were compared. pip-audit is not
pinned: it is taken from PATH, or run by uvx or pipx. The exit status is 1 if a pinned version is affected.
"""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from packaging.version import Version

LOCKS = ("requirements.lock", "requirements-dev.lock")
STORED = Path("workflow/advisories.txt")
HEADING = """\
# Package, versions affected (from, before), advisory. Of the pinned packages, from the Python Packaging Advisory
# Database (github.com/pypa/advisory-database, CC-BY 4.0), commit {commit}"""
PIN = re.compile(r"^([\w.-]+)==([^\s;\\]+)", re.MULTILINE)
RUNNERS = (["pip-audit"], ["uvx", "pip-audit"], ["pipx", "run", "pip-audit"])
OPTIONS = ["--disable-pip", "--no-deps", "--progress-spinner", "off", "--format", "json"]
LONGEST = 300  # seconds


class Advisory(NamedTuple):
    """Versions of a package that are affected by a vulnerability: first <= version < fixed."""

    package: str
    first: str
    fixed: str  # `-`: no version yet
    name: str

    def affects(self, version: str) -> bool:
        """Return whether a version is affected."""
        fixed = self.fixed == "-" or Version(version) < Version(self.fixed)
        return Version(self.first) <= Version(version) and fixed


def main(database: str | None = None) -> int:
    """Compare all pins, or write the stored advisories anew from a clone of the database. Return the exit status."""
    pins = read_pins()
    if database is not None:
        STORED.write_text(written(Path(database), pins), encoding="utf-8")
        return 0
    heading, advisories = read_stored(STORED.read_text(encoding="utf-8"))
    found = [f"{one.package} {pins[one.package]}: {one.name}" for one in advisories if is_hit(one, pins)]
    result = f"affected: {'; '.join(found)}" if found else "none is affected"
    say(f"{len(pins)} pinned versions, {len(advisories)} stored advisories ({heading}): {result}")
    looked_up, lines = ask_pip_audit(len(pins))
    say(f"current database: {looked_up}")
    for line in lines:
        say(line)
    return 1 if found or lines else 0


def is_hit(advisory: Advisory, pins: dict[str, str]) -> bool:
    """Return whether an advisory affects the pinned version of its package."""
    return advisory.package in pins and advisory.affects(pins[advisory.package])


def read_pins() -> dict[str, str]:
    """Return the pinned version of each package."""
    found = [PIN.findall(Path(lock).read_text(encoding="utf-8")) for lock in LOCKS]
    return {normal(name): version for pins in found for name, version in pins}


def normal(name: str) -> str:
    """Return the name of a package as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def read_stored(text: str) -> tuple[str, list[Advisory]]:
    """Return the date of the stored advisories, and these."""
    lines = text.splitlines()
    date = re.search(r"\d{4}-\d\d-\d\d", text)
    return date[0] if date else "without date", [Advisory(*line.split()) for line in lines if line and line[0] != "#"]


def ask_pip_audit(count: int) -> tuple[str, list[str]]:
    """Return how many of `count` pins pip-audit could look up in words, and a line for each that is affected."""
    runner = next((words for words in RUNNERS if shutil.which(words[0])), None)
    if runner is None:
        return "not asked, as there is no pip-audit, uvx or pipx", []
    locks = [word for lock in LOCKS for word in ("--requirement", lock)]
    try:
        done = subprocess.run([*runner, *locks, *OPTIONS], capture_output=True, text=True, timeout=LONGEST)
        packages = json.loads(done.stdout)["dependencies"]
    except (OSError, subprocess.TimeoutExpired, ValueError, KeyError):
        return f"not reached by {runner[-1]}; is there a network?", []
    known = [package for package in packages if "skip_reason" not in package]
    lines = [
        f"affected: {package['name']} {package['version']}: {', '.join(str(one['id']) for one in package['vulns'])}"
        for package in known
        if package["vulns"]
    ]
    result = f"{len(lines)} affected" if lines else "none of these is affected" if known else "nothing is known of them"
    return f"{len(known)} of {count} pinned versions found there by {runner[-1]}; {result}", lines


# -- the stored advisories ------------------------------------------------------------------------------------------


def written(database: Path, pins: dict[str, str]) -> str:
    """Return the text of the stored advisories: all of the pinned packages, from a clone of the database."""
    commit = ["git", "-C", str(database), "log", "-1", "--format=%h, %cs"]
    head = subprocess.run(commit, capture_output=True, text=True, check=True, timeout=LONGEST).stdout.strip()
    lines = [HEADING.format(commit=head)]
    folders = {normal(folder.name): folder for folder in (database / "vulns").iterdir()}
    for package in sorted(pins.keys() & folders.keys()):
        lines += sorted({" ".join(one) for file in folders[package].glob("*.yaml") for one in ranges(package, file)})
    return "\n".join(lines) + "\n"


def ranges(package: str, file: Path) -> Iterator[Advisory]:
    """Yield the ranges of versions that an advisory of the database names."""
    import yaml

    record = yaml.load(file.read_text(encoding="utf-8"), yaml.BaseLoader)  # versions stay texts
    if record.get("withdrawn"):
        return
    others = [name for name in record.get("aliases", []) if name.startswith("CVE")]
    name = ",".join([record["id"], *others[:1]])
    for affected in record["affected"]:
        for kind in (one for one in affected.get("ranges", []) if one["type"] == "ECOSYSTEM"):
            first = ""
            for event in kind["events"]:
                if "introduced" in event:
                    first = event["introduced"]
                elif "fixed" in event:
                    yield Advisory(package, first, event["fixed"], name)
                    first = ""
            if first:
                yield Advisory(package, first, "-", name)


def say(text: str) -> None:
    """Print a line."""
    print(f"brownpipe: audit: {text}", flush=True)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
