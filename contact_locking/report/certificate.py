"""The certificate of a run, in parts: judged values first, then the other values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

# Judgements name the number that bounds their value in one of these ways.
_LIMITS = ("bound", "limit")


@dataclass(frozen=True)
class Judgement:
    """A value beside its limit; ``holds`` is True or False, or anything else if neither applies."""

    name: str
    value: Any
    limit: Any
    holds: Any
    reason: Any


@dataclass(frozen=True)
class Part:
    """A part of the certificate; ``pairs`` are the names and values that are not judged."""

    title: str
    judgements: list[Judgement]
    pairs: list[tuple[str, Any]]


def certificate(summary: Mapping[str, Any]) -> list[Part]:
    """The parts of a summary's certificate that hold anything, whatever their names."""
    parts = summary.get("certificate")
    if not isinstance(parts, dict):
        parts = {"bounds": summary.get("bounds")}
    found = [_part(name, part) for name, part in parts.items() if isinstance(part, dict)]
    return [part for part in found if part.judgements or part.pairs]


def _part(name: str, part: Mapping[str, Any]) -> Part:
    judgements, others = [], {}
    for measure, entry in part.items():
        if isinstance(entry, dict) and "value" in entry and "holds" in entry:
            limit = next((entry[word] for word in _LIMITS if word in entry), None)
            told = (entry["value"], limit, entry["holds"], entry.get("reason"))
            judgements.append(Judgement(measure, *told))
        else:
            others[measure] = entry
    return Part(name.replace("_", " ").capitalize(), judgements, list(_flat(others)))


def _flat(value: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings under their dotted names."""
    for last, item in value.items():
        name = f"{above}{last}"
        if isinstance(item, dict):
            yield from _flat(item, f"{name}.")
        else:
            yield name, item
