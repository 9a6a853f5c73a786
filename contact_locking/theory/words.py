"""What is proved about a result, and how many solutions there are, in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from contact_locking.plain_text import count, per_cent
from contact_locking.results.in_words import (
    CHANGE,
    FORCES,
    NOT_USEFUL,
    has_friction,
    relative,
    spaced,
    vector,
)
from contact_locking.results.quantities import look_up

_UNIQUENESS = {
    "covered by theory": "proved: no other displacement solves the problem on this mesh",
    "covered for the discrete problem, by sampled constants": (
        "to be expected on this mesh, by constants that are sampled and not proved"
    ),
}


def rows(summary: Mapping[str, Any]) -> list[tuple[str, str | None]]:
    """What is known, in rows of a name and words; None where it was not asked for."""
    certificate = summary["certificate"]
    bound, several = certificate["errors"].get("guaranteed"), summary.get("equilibria")
    is_bound = bound is None or bound.get("applicable", True)
    critical = certificate.get("critical_friction")
    return [
        ("proved", _proved(summary) if "bounds" in summary else None),
        ("guaranteed bound", None if is_bound else bound["reason"]),
        ("limit load", _if_known(certificate.get("limit_load"), "load_factor", _limit_load)),
        ("critical friction", _if_known(critical, "share", _critical_friction)),
        ("uniqueness", _uniqueness(look_up(certificate, "constants.uniqueness"))),
        ("solutions found", several and f"{several['found']}; {several['missing']}"),
        ("branch of solutions", _branch(summary.get("branches"))),
    ]


def _branch(branch: Mapping[str, Any] | None) -> str | None:
    if branch is None:
        return None
    shares = ", ".join(f"{share:.4g}" for share in branch["folds"])
    folds = f"turns at the shares {shares}" if shares else "no turn was found"
    count = len(branch["points"]["share"])
    return f"over {branch['over']}: {count} points; {folds}; it ends: {branch['end']}"


def equilibria(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The table of several solutions of one problem; none without them."""
    section = summary.get("equilibria")
    if not section:
        return []
    head = ("equilibria", "contact force", "friction force", "elastic energy", "index")
    rows = [
        (
            entry["folder"],
            *(vector(entry[key] or ()) for key in FORCES),
            f"{entry['elastic_energy']:.4g}",
            f"{entry['index']:+d}",
        )
        for entry in section["solutions"]
    ]
    return [head, *rows]


def _if_known(
    entry: Mapping[str, Any] | None, key: str, words: Callable[[Mapping[str, Any]], str]
) -> str | None:
    """An entry in words, or the reason why its key is unknown; None if nobody asks for it."""
    if entry is None:
        return None
    return str(entry["reason"]) if entry[key] is None else words(entry)


def _critical_friction(entry: Mapping[str, Any]) -> str:
    mu = "" if entry["coefficient"] is None else f", the coefficient {entry['coefficient']:.4g}"
    return f"{entry['share']:.4g} times the given friction{mu}: the linearised problem is singular"


def _proved(summary: Mapping[str, Any]) -> str:
    bounds = summary["bounds"]
    reached = ", for the friction bound reached" if has_friction(summary) else ""
    broken = [spaced(name) for name, entry in bounds.items() if entry["holds"] is False]
    if broken:
        return f"violated: {', '.join(broken)}"
    held = sum(entry["holds"] is True for entry in bounds.values())
    parts = []
    if (whole := relative(summary, "guaranteed")) is not None:
        parts.append(_at_most("the whole error is", whole, "the whole error", reached))
    if distance := relative(summary, "penalty"):
        parts.append(_at_most(CHANGE, distance, "what the penalty changes", reached))
    if held:
        parts.append(f"the result keeps {count(held, 'bound')} of the theory")
    return "; ".join(parts) or "no bound applies"


def _at_most(change: str, bound: float, what: str, under: str) -> str:
    """A proved bound relative to the solution; above 100 % it says nothing of the solution."""
    if bound > 1.0:
        return f"{NOT_USEFUL} {what}"
    return f"{change} at most {per_cent(bound)}{under}"


def _limit_load(entry: Mapping[str, Any]) -> str:
    confirmed, excluded = entry["load_factor"]
    most = "any share" if excluded is None else f"more than {per_cent(excluded)}"
    least = f"{per_cent(confirmed)} can" if confirmed else "no share is proved to"
    return f"of the prescribed displacements {least} be followed, {most} on no mesh"


def _uniqueness(entry: Mapping[str, Any] | None) -> str | None:
    if entry is None:
        return None
    verdict: str = entry["verdict"]
    if verdict == "not unique":
        return f"proved: there are other solutions, as {entry['why']}"
    if verdict == "unique on this mesh":
        return f"proved: no other solution on this mesh, as {entry['why']}"
    if verdict == "not known":
        # summary.json has all reasons.
        return f"not known: {entry['why'].partition(';')[0]}"
    return _UNIQUENESS.get(verdict, verdict)
