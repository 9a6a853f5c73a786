"""Formulas as MathML, which browsers show without a script, so that the pages need no network."""

from __future__ import annotations

import re
from typing import Any

from docutils.nodes import Element, SkipNode, math, math_block
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util.logging import getLogger


def inline(writer: Any, node: math) -> None:
    """A formula in a line."""
    writer.body.append(_mathml(node, as_block=False))
    raise SkipNode


def display(writer: Any, node: math_block) -> None:
    """A formula of its own; it scrolls where the page is too narrow for it."""
    writer.body.append(f'<div class="formula">{_mathml(node, as_block=True)}</div>')
    raise SkipNode


# A browser sets a single letter in Unicode's mathematical italics, which few fonts have in full:
# instead it is an ordinary letter, which site.css slants; Greek capitals stay upright, as in TeX.
_LETTER = re.compile(r'<mi( class="capital-greek")?>([^\W\d_])</mi>')
# It takes a bar for an operator between two terms, with space on both sides.
_BAR = re.compile(r"<mo([^>]*)>\|</mo>")


def _ordinary(found: re.Match[str]) -> str:
    slanted = "" if found[1] else ' class="letter"'
    return f'<mi mathvariant="normal"{slanted}>{found[2]}</mi>'


def _mathml(node: Element, as_block: bool) -> str:
    text = node.astext()
    try:
        formula = _LETTER.sub(_ordinary, tex2mathml(text, as_block=as_block))
        return _BAR.sub(r'<mo\1 lspace="0" rspace="0">|</mo>', formula)
    except MathError as error:
        getLogger(__name__).warning("%s in the formula %r", error, text, location=node)
        return ""


def leave(writer: Any, node: Element) -> None:
    """Nothing is left to close."""


def setup(app: Any) -> dict[str, bool]:
    """Register the renderer as ``mathml``."""
    app.add_html_math_renderer("mathml", (inline, leave), (display, leave))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
