"""HTML made of elements, in which every text is escaped unless it is markup already."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from typing import Any


class Markup(str):
    """Text that is HTML already; any other string is escaped where it becomes content."""


Content = str | Iterable["Content"] | None

_VOID = frozenset({"img", "input", "meta"})


def element(name: str, *content: Content, **attributes: str | bool | None) -> Markup:
    """``<name attributes>content</name>``.

    Attributes are escaped; one that is None or False is left out, True has no value.  A trailing
    underscore in an attribute's name is dropped, others become dashes: ``class_``, ``data_value``.
    """
    words = [name]
    for key, value in attributes.items():
        attribute = key.rstrip("_").replace("_", "-")
        if value is True:
            words.append(attribute)
        elif value is not None and value is not False:
            words.append(f'{attribute}="{html.escape(value)}"')
    opened = f"<{' '.join(words)}>"
    return Markup(opened if name in _VOID else f"{opened}{markup(content)}</{name}>")


def markup(content: Content) -> Markup:
    """Content as HTML."""
    match content:
        case None:
            return Markup("")
        case Markup():
            return content
        case str():
            return Markup(html.escape(content))
    return Markup("".join(markup(item) for item in content))


def table(head: Sequence[str], rows: Iterable[Sequence[Content]], **attributes: str) -> Markup:
    """A table whose first column names its rows; it scrolls where it is too wide."""
    titles = element("tr", [element("th", title, scope="col") for title in head])
    body = [
        element("tr", element("th", row[0], scope="row"), [element("td", cell) for cell in row[1:]])
        for row in rows
    ]
    whole = element("table", element("thead", titles), element("tbody", body), **attributes)
    return element("div", whole, class_="scroll", tabindex="0")


def section(title: str, *content: Content, **attributes: str) -> Markup:
    """A part of the page under a heading; nothing if it would be empty."""
    inside = markup(content)
    if not inside:
        return inside
    return element("section", element("h2", title), inside, **attributes)


def key(name: str) -> Markup:
    """A dotted key, which may go on in a new line after a dot or an underscore."""
    return element("code", Markup(re.sub(r"(?<=[._])(?=.)", "<wbr>", html.escape(name))))


def formula(text: str) -> Markup:
    """A text with indices of one letter set as such: the C in Gamma_C."""
    return Markup(re.sub(r"_(\w)", r"<sub>\1</sub>", html.escape(text)))


def named(name: str, meaning: str | None) -> Markup:
    """A key above what it means."""
    about = element("div", formula(meaning), class_="soft") if meaning else None
    return markup((key(name), about))


def shown(value: Any) -> str:
    """A value of a summary or a table as one reads it."""
    match value:
        case None:
            return "\N{EN DASH}"
        case bool():
            return "yes" if value else "no"
        case int() if abs(value) < 10**15:
            return f"{value:,}".replace(",", "\N{THIN SPACE}")
        case int() | float() if abs(value) < 1e308:
            return _number(float(value))
        case int() | float():
            return _infinite(value)
        case "inf":
            return "\N{INFINITY}"
        case list():
            return "(" + ", ".join(map(shown, _without_rounding(value))) + ")"
        case dict():
            return ", ".join(f"{key}: {shown(item)}" for key, item in value.items())
    return str(value)


def _without_rounding(vector: list[Any]) -> list[Any]:
    """Components of a vector that are zero but for rounding as zero."""
    if not vector or not all(isinstance(item, float) for item in vector):
        return vector
    largest = max(map(abs, vector))
    return [0.0 if abs(item) < 1e-12 * largest else item for item in vector]


def _infinite(value: float) -> str:
    if value != value:
        return "not a number"
    return "\N{INFINITY}" if value > 0 else "\N{MINUS SIGN}\N{INFINITY}"


def _number(value: float) -> str:
    """Four digits, and a power of ten in words of mathematics: 1.2x10^-5 for 1.2e-05."""
    mantissa, _, exponent = f"{value + 0.0:.4g}".replace("-", "\N{MINUS SIGN}").partition("e")
    if not exponent:
        return mantissa
    power = exponent.lstrip("+").replace("\N{MINUS SIGN}", "-")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if mantissa == "1" else f"{mantissa}\N{MULTIPLICATION SIGN}10{raised}"
