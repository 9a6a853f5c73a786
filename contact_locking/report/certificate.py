"""The certificate of a run as tables, whatever it holds: judged values first, then the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from .markup import Content, Markup, element, named, section, shown, table
from .quantities import MEANINGS

#: How a judgement names what its value is compared with.
_LIMITS = ("bound", "limit")


def certificate(summary: Mapping[str, Any]) -> Markup:
    """What is proved or required, each beside its measured value."""
    parts = summary.get("certificate")
    if not isinstance(parts, dict):
        parts = {"bounds": summary.get("bounds")}
    told = [_part(str(name), part) for name, part in parts.items() if isinstance(part, dict)]
    inside = [part for part in told if part]
    return section("Certificate", element("div", inside, class_="packed") if inside else None)


def _part(name: str, part: Mapping[str, Any]) -> Markup | None:
    judged = {measure: entry for measure, entry in part.items() if _is_judgement(entry)}
    others = {measure: entry for measure, entry in part.items() if measure not in judged}
    content: list[Content] = []
    if judged:
        head = ("", "measured", "at most", "")
        content.append(table(head, [_judgement(*item) for item in judged.items()]))
    if rows := list(_flat(others)):
        told = [[named(name, MEANINGS.get(name)), text] for name, text in rows]
        content.append(table(("", "value"), told))
    title = element("h3", name.replace("_", " ").capitalize())
    return element("div", title, content) if content else None


def _is_judgement(entry: Any) -> bool:
    return isinstance(entry, dict) and "value" in entry and "holds" in entry


def _judgement(name: str, entry: Mapping[str, Any]) -> list[Content]:
    bound = next((entry[word] for word in _LIMITS if word in entry), None)
    match entry["holds"]:
        case True:
            mark = element("span", "✓ holds", class_="yes")
        case False:
            mark = element("span", "✗ fails", class_="no")
        case _:
            mark = element("span", "not applicable", class_="soft")
    reason = entry.get("reason")
    about = element("div", shown(reason), class_="soft") if reason else None
    return [named(name, MEANINGS.get(name)), _number(entry["value"]), _number(bound), [mark, about]]


def _number(value: Any) -> Markup:
    return element("span", shown(value), class_="number")


def _flat(value: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for last, item in value.items():
        name = f"{above}{last}"
        if isinstance(item, dict):
            yield from _flat(item, f"{name}.")
        else:
            yield name, shown(item)
