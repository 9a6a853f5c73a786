"""Text of somebody else's as it may be shown."""

from __future__ import annotations

import re
import unicodedata

# A spreadsheet takes these for formulas, which can start programs; -2*x and the like are texts.
_FORMULA = re.compile(r"[=@\t\r]|[-+].*[|!]", re.DOTALL)


def printable(text: str, keep: str = "\n") -> str:
    """The text with what a terminal would obey, or not show, as escapes; ``keep`` stays."""
    if text.isprintable():
        return text
    return "".join(c if c in keep or _is_shown(c) else ascii(c)[1:-1] for c in text)


def spreadsheet_cell(text: str) -> str:
    """The text behind an apostrophe if a spreadsheet would take it for a formula."""
    return f"'{text}" if _FORMULA.match(text) else text


def _is_shown(character: str) -> bool:
    # Other, and what separates lines and paragraphs; other white space is harmless.
    return character.isprintable() or unicodedata.category(character) == "Zs"
