"""The page of equations names functions that exist, all equations of the note, and references that it has."""

import inspect
import pkgutil
import re
from collections import Counter
from pathlib import Path

import pytest

PAGE = (Path(__file__).parent.parent / "docs" / "theory.md").read_text()
EQUATIONS = range(1, 19)
RANGE = r"\((\d+)\)(?:(?:-|\\text\{-\})\((\d+)\))?"  # (4), (1)-(3), or the latter within math
FUNCTIONS = re.findall(r"`((?:analysis|engines|observables|scene|theory)\.[\w.]+)`", PAGE)
FORMULAS = re.findall(r"^```math\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


def numbers(found):
    """The equations in ranges (first, last or "")."""
    return [number for first, last in found for number in range(int(first), int(last or first) + 1)]


@pytest.mark.parametrize("name", sorted(set(FUNCTIONS)))
def test_a_function_on_the_page_exists(name):
    function = pkgutil.resolve_name(f"brownpipe.{name}")
    assert callable(function) and not inspect.isclass(function)


def test_every_equation_of_the_note_is_written_out_once():
    written = [found for formula in FORMULAS for found in re.findall(r"\\q?quad *" + RANGE, formula)]
    assert Counter(numbers(written)) == Counter(EQUATIONS)


def test_every_reference_is_cited_and_every_citation_has_a_reference():
    text, _, references = PAGE.partition("\n## References\n")
    listed = [int(number) for number in re.findall(r"^(\d+)\. ", references, re.MULTILINE)]
    cited = {int(number) for number in re.findall(r"\[(\d+)\]", text)}
    assert listed == list(range(1, len(listed) + 1))
    assert cited == set(listed)


def test_formulas_are_closed():
    text = re.sub(r"^```math\n.*?^```\n", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    paragraphs = text.split("\n\n")
    assert not [paragraph for paragraph in paragraphs if paragraph.count("$") % 2]
    inline = [formula for paragraph in paragraphs for formula in paragraph.split("$")[1::2]]
    for formula in (*inline, *FORMULAS):
        for opening, closing in ((r"{", r"}"), (r"\\left\b", r"\\right\b"), (r"\\begin\b", r"\\end\b")):
            assert len(re.findall(opening, formula)) == len(re.findall(closing, formula)), formula
    assert not [formula for formula in inline if re.search(r"\\[^a-zA-Z]", formula)]  # Markdown takes the backslash
