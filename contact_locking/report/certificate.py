"""The certificate of a run, in parts: judged values first, then the other values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple


class Part(NamedTuple):
    """``judged`` are entries with ``value`` and ``holds``, ``others`` all other values, by name."""

    title: str
    judged: dict[str, Any]
    others: dict[str, Any]


def certificate(summary: Mapping[str, Any]) -> list[Part]:
    """The parts of a summary's certificate that hold anything, whatever their names."""
    parts = summary.get("certificate")
    if not isinstance(parts, dict):
        parts = {"bounds": summary.get("bounds")}
    found = []
    for name, part in parts.items():
        if isinstance(part, dict):
            judged = {key: entry for key, entry in part.items() if _is_judged(entry)}
            others = {key: entry for key, entry in part.items() if key not in judged}
            title = name.replace("_", " ").capitalize()
            found.append(Part(title, judged, dict(_flat(others))))
    return [part for part in found if part.judged or part.others]


def _is_judged(entry: Any) -> bool:
    return isinstance(entry, dict) and "value" in entry and "holds" in entry


def _flat(value: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings under their dotted names."""
    for last, item in value.items():
        name = f"{above}{last}"
        if isinstance(item, dict):
            yield from _flat(item, f"{name}.")
        else:
            yield name, item
