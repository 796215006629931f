"""Gather the pages of the site from where they lie in the repository: links between them are those
of the site.

    python docs/_ext/pages.py FOLDER

On the site the pages lie side by side. A file that is linked, but is no page, is copied for
download.
"""

import re
import shutil
import sys
from collections.abc import Iterator
from os.path import normpath
from pathlib import Path, PurePosixPath

ROOT = Path(__file__).parents[2]
PAGES = {  # name on the site: file in the repository
    "index": "docs/site/index.md",
    "overview": "README.md",
    "guide": "docs/guide.md",
    "tutorial": "docs/tutorial.md",
    "configuration": "config/README.md",
    "results": "docs/results.md",
    "cluster": "docs/cluster.md",
    "python": "docs/site/python.md",
    "theory": "docs/theory.md",
    "validation": "docs/validation.md",
    "stability": "docs/stability.md",
    "benchmarks": "docs/benchmarks.md",
    "other_programs": "docs/other_programs.md",
    "decisions": "docs/decisions.md",
    "compiled": "docs/compiled.md",
    "contributing": "CONTRIBUTING.md",
}
NAMES = {file: name for name, file in PAGES.items()}
FENCED = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(\[[^\]\n]*\]\()([^)\s#:]+)((?:#[^)\s]*)?\))|(<img src=\")([^\":]+)()")


def page_of_site(file: str) -> tuple[str, dict[str, Path]]:
    """Return the text of a page with the links of the site, and the other files that it links:
    name, file.
    """
    linked: dict[str, Path] = {}
    parts = FENCED.split((ROOT / file).read_text())
    shown = [
        part
        if part.startswith("```")
        else LINK.sub(lambda link: _on_site(link, file, linked), part)
        for part in parts
    ]
    return "".join(shown), linked


def _on_site(link: re.Match, file: str, linked: dict[str, Path]) -> str:
    """Return a link from a page as it is on the site; enter its file in `linked` if it is no
    page.
    """
    before, target, after = (
        found or "" for found in (link.groups()[:3] if link[1] else link.groups()[3:])
    )
    path = normpath(PurePosixPath(file).parent / target)
    if path in NAMES:
        return f"{before}{NAMES[path]}.md{after}"
    if (ROOT / path).is_dir():  # which no page shows
        return before.removeprefix("[").removesuffix("](")
    if not (
        ROOT / path
    ).exists():  # a page that is made when the site is built, or a mistake, which Sphinx finds
        return link[0]
    name = f"files/{path}"
    linked[name] = ROOT / path
    return f"{before}{name}{after}"


def pages() -> Iterator[tuple[str, str, dict[str, Path]]]:
    """Yield name and text of each page of the site, and the files that it links."""
    import gallery
    import reference

    for name, file in PAGES.items():
        yield (name, *page_of_site(file))
    yield "command_line", reference.command_line(), {}
    yield "files", reference.files(), {}
    yield ("gallery", *gallery.page())


def gather(folder: Path) -> None:
    """Write all pages, and the files that they link, into a folder that is made anew."""
    from session import executed

    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name, text, linked in pages():
        for place, file in linked.items():
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, folder / place)
        if name == "tutorial":
            text = executed(text, folder)
        (folder / f"{name}.md").write_text(text)


if __name__ == "__main__":
    from session import DriftError

    try:
        gather(Path(sys.argv[1]).resolve())
    except DriftError as error:
        sys.exit(f"brownpipe: docs/tutorial.md: {error}")
