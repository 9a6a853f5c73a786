"""Text from files and users, made safe for terminals and spreadsheets."""

from __future__ import annotations

import re
import unicodedata

# A spreadsheet takes such text for a formula, which can start programs; -2*x and the like are no
# danger and stay as they are.
_FORMULA = re.compile(r"[=@\t\r]|[-+].*[|!]", re.DOTALL)


def printable(text: str, keep: str = "\n") -> str:
    """The text with escapes for control and invisible characters, except those in ``keep``."""
    if text.isprintable():
        return text
    return "".join(c if c in keep or _is_shown(c) else ascii(c)[1:-1] for c in text)


def spreadsheet_cell(text: str) -> str:
    """The text, behind an apostrophe if a spreadsheet would take the text for a formula."""
    return f"'{text}" if _FORMULA.match(text) else text


def _is_shown(character: str) -> bool:
    # White space is harmless, except separators of lines and paragraphs.
    return character.isprintable() or unicodedata.category(character) == "Zs"
