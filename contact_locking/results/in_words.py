"""The outcome of a run in words: convergence, proofs, estimates, and the weakest number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from contact_locking import wings
from contact_locking.plain_text import count, per_cent
from contact_locking.results.quantities import QUANTITIES, Quantity, look_up, of_result

# A result whose weakest number is above this share of the solution is a rough one.
ROUGH = 0.1
NOT_USEFUL = "there is no useful bound (below 100 %) of"

FORCES = ("contact_force", "friction_force")
CHANGE = "the penalty changes the solution on this mesh by"


@dataclass(frozen=True)
class Weakness:
    """An error relative to the solution in the energy norm.

    ``words`` is a clause with the error and its source, and ``advice`` says how to reduce it.
    """

    share: float
    words: str
    advice: str

    @property
    def is_rough(self) -> bool:
        """Whether the error is so large that the result is rough."""
        return self.share > ROUGH


def weakest(summary: Mapping[str, Any]) -> Weakness | None:
    """The largest error of the certificate, None without any.

    The keys of the summary may be dotted, as in the row of a study.
    """
    weaknesses = list(_weaknesses(summary))
    return max(weaknesses, key=lambda weakness: weakness.share) if weaknesses else None


def verdict(summary: Mapping[str, Any]) -> str:
    """Whether the run converged, with a reservation if the result is rough."""
    if not summary["converged"]:
        return "no"
    if ended := (summary.get("steps") or {}).get("ended"):
        return f"yes, but {ended}"
    weak = weakest(summary)
    return f"yes, but the result is rough: {weak.words}" if weak and weak.is_rough else "yes"


def rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The outcome in rows of a name and words."""
    iterations = summary["iterations"]
    kinds = {"tangents": "tangent", "linear": "linear solve", "friction": "friction update"}
    counts = [count(iterations[key], name) for key, name in kinds.items()]
    kinds = {"cells": "cell", "dofs": "unknown", "ranks": "rank"}
    sizes = [count(summary[key], name) for key, name in kinds.items()]
    element = summary["discretisation"]
    body = "; axisymmetric" if element.get("axisymmetric") else ""
    weakness = weakest(summary)
    weak = "not known" if weakness is None else weakness.words
    if weakness is not None and weakness.is_rough:
        weak = f"{weak}; to improve it: {weakness.advice}"
    all_rows = [
        ("converged", f"{verdict(summary)} (residual {summary['residual']:.1e})"),
        ("restart", summary.get("restart")),
        *_quantities(summary),
        ("reactions", _reactions(summary)),
        *_tools(summary["contacts"]),
        ("criteria", _criteria(summary["certificate"]["criteria"])),
        *(row for words in wings.WORDS for row in words(summary)),
        ("estimated", _estimated(summary)),
        ("weakest number", weak),
        ("derivatives", (summary.get("share_at_change") or {}).get("in_words")),
        ("size", f"{', '.join(sizes)}; elements of degree {element['degree']}{body}"),
        ("iterations", ", ".join(counts)),
        ("time", f"{summary['wall_seconds']:.1f} s"),
    ]
    return [(name, words) for name, words in all_rows if words]


def _quantities(summary: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    """The computed quantities that the summary knows, of several contacts those of each."""
    units, contacts = summary.get("units", {}), summary["contacts"]
    for key, quantity in of_result((), units).items():
        if quantity.compute is None or quantity.detail:
            continue
        of_each = quantity.of == "contact" and len(contacts) != 1
        values = [
            value_in_words(quantity, entry[key], entry.get(f"{key}_at"))
            + (f" on {entry['name']}" if of_each else "")
            for entry in (contacts if of_each else [summary])
            if entry.get(key) is not None and entry.get(quantity.beside or key) is not None
        ]
        if values:
            yield quantity.name, ", ".join(values)


def value_in_words(quantity: Quantity, value: Any, place: Sequence[float] | None = None) -> str:
    """A value of a quantity in words, with the label of its unit and its place if it has some."""
    if quantity.share_of:
        return f"{per_cent(value)} of {quantity.share_of}"
    words = vector(value) if isinstance(value, list) else f"{value:.4g}"
    if quantity.unit not in ("1", QUANTITIES[quantity.key].unit):
        words = f"{words} {quantity.unit}"
    return words if place is None else f"{words} {quantity.at} {vector(place)}"


def _weaknesses(summary: Mapping[str, Any]) -> Iterable[Weakness]:
    if (mesh := relative(summary, "mesh")) is not None:
        words = f"the error of the mesh is about {_roughly(mesh)}, by an estimate"
        # Meshes of steps and of boxes cannot be adapted.
        is_fixed = summary.get("steps") or look_up(summary, "discretisation.cells") == "box"
        adapt = "" if is_fixed else ", or the section adapt"
        yield Weakness(mesh, words, f"a finer mesh{adapt}")
    measured, bound = relative(summary, "penalty_measured"), relative(summary, "penalty")
    if measured:
        words = f"the penalty changes the solution by {per_cent(measured)}, as measured"
        yield Weakness(measured, words, "a larger penalty.n, or .inf")
    elif measured is None and bound:
        words = f"the penalty changes the solution by at most {per_cent(bound)}, by a proved bound"
        if has_friction(summary):
            words += " for the friction bound reached"
        if bound > 1.0:
            words = f"{NOT_USEFUL} what the penalty changes"
        advice = "certificate.limit: true, which measures the change, or a larger penalty.n"
        yield Weakness(bound, words, advice)


def relative(summary: Mapping[str, Any], name: str) -> float | None:
    """An error of the certificate relative to the solution; None where it is not known."""
    return number(look_up(summary, f"certificate.errors.{name}.relative"))


def has_friction(summary: Mapping[str, Any]) -> bool:
    """Whether friction acts, or would if there were a pressure."""
    coefficient = look_up(summary, "certificate.constants.friction_coefficient")
    return bool(coefficient) or summary.get("friction_used") is not None


def vector(values: Iterable[float], largest: float = 0.0) -> str:
    """The vector, with zero for components that are only rounding.

    ``largest`` is the largest of the numbers that the vector is computed from, if known.
    """
    numbers = list(values)
    least = 1e-12 * max(map(abs, numbers), default=0.0)
    least = max(least, 1e-14 * largest)
    shown = [0.0 if abs(value) < least else value + 0.0 for value in numbers]
    return "(" + ", ".join(f"{value:.4g}" for value in shown) + ")"


def _tools(contacts: Iterable[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """The travel of each pushed foundation, with its forces."""
    rows = []
    for entry in contacts:
        if tool := entry.get("tool"):
            words = [f"moved by {tool['travel']:.6g} along {vector(tool['direction'])}"]
            if tool["force"] or "spring_force" not in tool:
                words.append(f"pushed by {tool['force']:.6g}")
            if "spring_force" in tool:
                words.append(f"spring force {tool['spring_force']:.6g}")
            rows.append((f"foundation on {entry['name']}", ", ".join(words)))
    return rows


def _reactions(summary: Mapping[str, Any]) -> str:
    reactions = summary["reactions"]
    each = [entry.get(key) for entry in (summary, *summary["contacts"]) for key in FORCES]
    forces = [*filter(None, each), *reactions.values()]
    largest = max((abs(value) for force in forces for value in force), default=0.0)
    parts = [f"{vector(force, largest)} on {name}" for name, force in reactions.items()]
    return ", ".join(parts)


def _criteria(criteria: Mapping[str, Mapping[str, Any]]) -> str:
    """The criteria that fail; if all hold, the one nearest to its limit."""
    failed = [
        f"{spaced(name)} {entry['value']:.1e}, above {entry['limit']:g}"
        for name, entry in criteria.items()
        if not entry["holds"]
    ]
    if failed:
        return f"{len(failed)} of {len(criteria)} fail: {'; '.join(failed)}"
    name, entry = max(criteria.items(), key=lambda pair: pair[1]["value"] / pair[1]["limit"])
    share = per_cent(entry["value"] / entry["limit"])
    return f"all {len(criteria)} hold; nearest to its limit: {spaced(name)}, at {share} of it"


def _estimated(summary: Mapping[str, Any]) -> str:
    mesh, measured = relative(summary, "mesh"), relative(summary, "penalty_measured")
    parts = [] if mesh is None else [f"the error of the mesh is about {_roughly(mesh)}"]
    if measured is not None:
        parts.append(f"measured: {CHANGE} {per_cent(measured)}")
    return "; ".join(parts) or "no estimate applies"


def _roughly(share: float) -> str:
    """An estimate, with two digits."""
    return f"{100.0 * share:.2g} %" if share < 1.0 else per_cent(share)


def spaced(name: str) -> str:
    """A key of the summary as words."""
    return name.replace("_", " ")


def number(value: Any) -> float | None:
    """The number in a cell of a table, where infinity is a text; None for other values."""
    if isinstance(value, bool) or not (isinstance(value, int | float) or value in ("inf", "-inf")):
        return None
    try:
        converted = float(value)
    except OverflowError:
        return None
    return None if math.isnan(converted) else converted
