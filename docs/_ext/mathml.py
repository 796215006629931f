"""Formulas as MathML, made when the site is built: browsers set MathML by themselves, without
scripts or a network.

The font is STIX Two Math, of the package ziamath, reduced to the characters of formulas.
"""

import io
import logging
import re
from importlib.resources import files
from pathlib import Path

from docutils import nodes
from fontTools.subset import Options, Subsetter
from fontTools.ttLib import TTFont
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util.logging import getLogger
from sphinx.writers.html5 import HTML5Translator

# ranges of Unicode: Latin and Greek letters, punctuation, arrows, operators, brackets, italics
CHARACTERS = (
    *(
        (0x20, 0x7E),
        (0xA0, 0xFF),
        (0x2C0, 0x2DF),
        (0x302, 0x302),
        (0x370, 0x3FF),
        (0x2000, 0x206F),
        (0x2100, 0x214F),
    ),
    *((0x2190, 0x21FF), (0x2200, 0x22FF), (0x2300, 0x23FF), (0x27E6, 0x27EB), (0x1D400, 0x1D7FF)),
)
# of latex2mathml: a number and not an operator; a sign; no blanks around a bar or a slash
CORRECTIONS = {
    "<mo>&#x0221E;</mo>": "<mi>&#x0221E;</mi>",
    '<mo stretchy="false">&#x0007C;</mo>': (
        '<mo stretchy="false" lspace="0" rspace="0">&#x0007C;</mo>'
    ),
    "<mo>&#x0003D;</mo><mo>&#x02212;</mo>": '<mo>&#x0003D;</mo><mo form="prefix">&#x02212;</mo>',
    "<mo>&#x0002F;</mo>": '<mo lspace="0.05em" rspace="0.05em">&#x0002F;</mo>',
}
# A sum with one limit, which latex2mathml takes for an index between brackets; browsers put it
# below in a block only.
SUM = re.compile(
    r"<msub>(<mo>&#x02211;</mo>(?:<mrow>(?:(?!mrow).)*</mrow>|<m[ino]>[^<]*</m[ino]>))</msub>"
)
# A prime is raised by its own shape; as an exponent it would be small and far away.
PRIME = '<mo lspace="0" rspace="0">&#x02032;</mo>'
PRIMES = {
    re.compile(r"<msup>(<mi>[^<]*</mi>)<mi>&#x02032;</mi></msup>"): rf"<mrow>\1{PRIME}</mrow>",
    re.compile(r"<msubsup>(<mi>[^<]*</mi>)(<mi>[^<]*</mi>)<mi>&#x02032;</mi></msubsup>"): (
        rf"<msub><mrow>\1{PRIME}</mrow>\2</msub>"
    ),
}


def mathml(latex: str, display: str) -> str:
    """Return a formula as MathML, `display` inline or block. Raises ValueError for what is not
    understood.
    """
    text = convert(latex.replace("{aligned}", "{align*}"), display=display)
    if "\\" in text or "&amp;" in text:
        raise ValueError(f"no MathML for the formula {latex!r}")
    for found, better in CORRECTIONS.items():
        text = text.replace(found, better)
    for prime, better in PRIMES.items():
        text = prime.sub(better, text)
    return SUM.sub(r"<munder>\1</munder>", text)


def font() -> bytes:
    """Return the font of formulas in the format WOFF."""
    options = Options(flavor="woff")
    whole = TTFont(files("ziamath") / "fonts" / "STIXTwoMath-Regular.ttf", recalcTimestamp=False)
    subsetter = Subsetter(options)
    subsetter.populate(
        unicodes=[code for first, last in CHARACTERS for code in range(first, last + 1)]
    )
    logging.getLogger("fontTools.subset").setLevel(logging.ERROR)
    subsetter.subset(whole)
    whole.flavor = options.flavor
    written = io.BytesIO()
    whole.save(written)
    return written.getvalue()


def _visit_inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(_written(node, "inline"))
    raise nodes.SkipNode


def _visit_block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formula">{_written(node, "block")}</div>\n')
    raise nodes.SkipNode


def _written(node: nodes.Node, display: str) -> str:
    """Return the MathML of a node; a formula that is not understood is a warning of Sphinx, with
    its page and line.
    """
    try:
        return mathml(node.astext(), display)
    except ValueError as error:
        getLogger(__name__).warning(str(error), location=node)
        return ""


def _write_font(app: Sphinx, error: Exception | None) -> None:
    if error is None:
        (Path(app.outdir) / "_static" / "STIXTwoMath.woff").write_bytes(font())


def setup(app: Sphinx) -> dict[str, bool]:
    """Make this the way in which Sphinx writes formulas."""
    app.add_html_math_renderer(
        "mathml", inline_renderers=(_visit_inline, None), block_renderers=(_visit_block, None)
    )
    app.connect("build-finished", _write_font)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
