"""A page with all results of a dataset: one HTML file that needs neither network nor other files."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from brownpipe.figures.origin import closing_lines
from brownpipe.quoting import shell_path
from brownpipe.report.parts import details, paragraphs, table, text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from brownpipe.figures.origin import Record

STYLE, SCRIPT = (Path(__file__).with_suffix(suffix) for suffix in (".css", ".js"))
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"  # nothing is loaded
HINT = "Point at a figure or tap it: the nearest point shows its values. By keyboard: Tab to a figure, then arrow keys."
FROM_DATASET = ("sha256", "source_digest", "git_commit", "python")


class Section(NamedTuple):
    """A part of a page with a heading."""

    name: str  # by which links find it
    heading: str
    contents: str  # HTML


def page(title: str, lead: str, sections: Sequence[Section], record: Record, name: str) -> bytes:
    """Return the page: a title, a sentence below it, its sections, and how to make it again.

    record: what it was made from. name: that of its file.
    """
    sections = [*sections, Section("again", "Make it again", _again(record, name))]
    links = "".join(f'<li><a href="#{section.name}">{text(section.heading)}</a></li>' for section in sections)
    body = "\n".join(
        f'<section id="{section.name}">\n<h2>{text(section.heading)}</h2>\n{section.contents}</section>'
        for section in sections
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{text(title)}: {text(lead)}</title>
<style>
{STYLE.read_text(encoding="utf-8")}</style>
</head>
<body>
<header>
<h1>{text(title)}</h1>
<p>{text(lead)}</p>
<nav aria-label="Sections"><ul>{links}</ul></nav>
</header>
<main>
{body}
</main>
<script>
{SCRIPT.read_text(encoding="utf-8")}</script>
</body>
</html>
""".encode()


def _again(record: Record, name: str) -> str:
    """Return the commands that make page and runs again, versions and digests, and the record."""
    made_from = record["dataset"].get("made_from", []) + ([record["replay"]] if "replay" in record else [])
    commands = "\n".join(text(origin["command"]) for origin in made_from)
    stated = json.dumps({"file": name} | record, sort_keys=True, indent=1)
    runs = f"<p>The runs:</p>\n{_code(commands)}" if commands else ""
    return (
        "<p>This makes the page again, from the dataset or without it from scenes and seeds, and compares every"
        f" byte:</p>\n{_code(text(f'brownpipe inspect {shell_path(name)} --reproduce'))}{runs}"
        f"{paragraphs(closing_lines(record).splitlines()[:1], 'remark')}"
        + details("Versions and digests", table(_versions(record), "Versions and digests"))
        + details("Scenes, seeds, options", f'<pre tabindex="0">{html.escape(stated, quote=False)}</pre>\n')
    )


def _code(lines: str) -> str:
    return f'<pre tabindex="0"><code>{lines}</code></pre>\n'


def _versions(record: Record) -> list[list[str]]:
    """Return what made the dataset and the figures, by columns."""
    made, dataset = record["made_by"], record["dataset"]
    names = sorted(name for name in {**dataset, **made} if name.endswith("_version"))
    names = [*(name for name in FROM_DATASET if name in dataset), *names]
    return [
        ["", *(name.removesuffix("_version").replace("sha256", "SHA-256").replace("_", " ") for name in names)],
        ["dataset", *(str(dataset.get(name, "-")) for name in names)],
        ["figures", *(str(made.get(name, "-")) for name in names)],
    ]
