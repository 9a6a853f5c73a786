"""Text in messages and files: the text of others made safe to show, and the nearest known name."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable

# A spreadsheet takes these for formulas, which can start programs; -2*x and the like are texts.
_FORMULA = re.compile(r"[=@\t\r]|[-+].*[|!]", re.DOTALL)

_ROUNDING = 1e-9


def printable(text: str, keep: str = "\n") -> str:
    """The text with escapes for control characters and characters that a terminal does not show.

    The characters in ``keep`` stay.
    """
    if text.isprintable():
        return text
    return "".join(c if c in keep or _is_shown(c) else ascii(c)[1:-1] for c in text)


def spreadsheet_cell(text: str) -> str:
    """The text behind an apostrophe if a spreadsheet would take it for a formula."""
    return f"'{text}" if _FORMULA.match(text) else text


def count(number: int, name: str) -> str:
    """``1 cell``, ``2 cells``."""
    return f"{number} {name}" if number == 1 else f"{number} {name}s"


def per_cent(share: float) -> str:
    """A share in per cent with one decimal, or two digits where it is small: 0.5 %, 20 %.

    The same share reads the same in the summary, in pictures and in reports.
    """
    value = 100.0 * share
    if value == 0.0:
        return "0 %"
    if abs(value) < 0.01:
        return f"{value:.0e} %"
    return f"{value:.2g} %" if abs(value) < 1.0 else f"{value:.1f} %".replace(".0 %", " %")


def coordinates(point: Iterable[float]) -> str:
    """The coordinates of a point, ``14, 0``; those that are rounding beside the others are 0."""
    numbers = [float(x) for x in point]
    rounding = _ROUNDING * max(map(abs, numbers), default=0.0)
    return ", ".join(f"{0.0 if abs(x) <= rounding else x:.3g}" for x in numbers)


def duration(seconds: float) -> str:
    """A time in seconds, minutes or hours, as its length suggests."""
    if seconds < 99.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 100:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"


def gigabytes(size: float) -> str:
    """Bytes in GB (1e9 bytes) with one decimal where there are few: 0.3 GB, 12 GB."""
    value = size / 1e9
    return f"{value:.1f} GB" if value < 9.95 else f"{value:.0f} GB"


def nearest(name: str, known: Iterable[str]) -> str:
    """The hint at the known name that is most like ``name``; empty if no name is like it.

    A name with ``name`` as one of its words, such as inner_radius for inner, is most like it.
    """
    names = list(known)
    longer = [other for other in names if name in other.split("_")]
    matches = longer or difflib.get_close_matches(name, names, n=1)
    return f" (did you mean '{matches[0]}'?)" if matches else ""


def _is_shown(character: str) -> bool:
    # Blanks of every width are harmless; separators of lines and paragraphs are not shown.
    return character.isprintable() or unicodedata.category(character) == "Zs"
