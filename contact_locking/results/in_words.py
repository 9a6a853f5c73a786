"""The outcome of a run in words: convergence, proofs, estimates, and the weakest number."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from contact_locking.plain_text import count, per_cent
from contact_locking.results.quantities import QUANTITIES, Quantity, look_up, of_result
from contact_locking.results.read import number

# A result whose weakest number is above this share of the solution is a rough one.
ROUGH = 0.1
NOT_USEFUL = "there is no useful bound (below 100 %) of"

_FORCES = ("contact_force", "friction_force")
_CHANGE = "the penalty changes the solution on this mesh by"
_UNIQUENESS = {
    "covered by theory": "proved: no other displacement solves the problem on this mesh",
    "covered for the discrete problem, by sampled constants": (
        "to be expected on this mesh, by constants that are sampled and not proved"
    ),
}


@dataclass(frozen=True)
class Weakness:
    """An error relative to the solution in the energy norm, and how the program knows the error.

    ``words`` are a clause about the error, and ``advice`` says how to make it smaller.
    """

    share: float
    words: str
    advice: str

    @property
    def is_rough(self) -> bool:
        """Whether the error is so large that the result is a rough one."""
        return self.share > ROUGH


def weakest(summary: Mapping[str, Any]) -> Weakness | None:
    """The largest of the errors that the certificate knows; None if it knows none.

    The keys of the summary may be dotted, as in the row of a study.
    """
    found = list(_weaknesses(summary))
    return max(found, key=lambda weakness: weakness.share) if found else None


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
    iterations, certificate = summary["iterations"], summary["certificate"]
    kinds = {"tangents": "tangent", "linear": "linear solve", "friction": "friction update"}
    counts = [count(iterations[key], name) for key, name in kinds.items()]
    kinds = {"cells": "cell", "dofs": "unknown", "ranks": "rank"}
    sizes = [count(summary[key], name) for key, name in kinds.items()]
    element = summary["discretisation"]
    body = "; axisymmetric" if element.get("axisymmetric") else ""
    errors, critical = certificate["errors"], certificate.get("critical_friction")
    bound = errors.get("guaranteed", {})
    found = [
        ("converged", f"{verdict(summary)} (residual {summary['residual']:.1e})"),
        ("restart", summary.get("restart")),
        *_quantities(summary),
        ("reactions", _reactions(summary)),
        *_tools(summary["contacts"]),
        ("criteria", _criteria(certificate["criteria"])),
        ("proved", _proved(summary) if "bounds" in summary else None),
        ("guaranteed bound", None if bound.get("applicable", True) else bound["reason"]),
        ("limit load", _if_known(certificate.get("limit_load"), "load_factor", _limit_load)),
        ("critical friction", _if_known(critical, "share", _critical_friction)),
        ("estimated", _estimated(summary)),
        ("weakest number", _weakest(summary)),
        ("uniqueness", _uniqueness(look_up(certificate, "constants.uniqueness"))),
        ("solutions found", _several(summary.get("equilibria"))),
        ("branch of solutions", _branch(summary.get("branches"))),
        ("derivatives", (summary.get("share_at_change") or {}).get("in_words")),
        ("size", f"{', '.join(sizes)}; elements of degree {element['degree']}{body}"),
        ("iterations", ", ".join(counts)),
        ("time", f"{summary['wall_seconds']:.1f} s"),
    ]
    return [(name, words) for name, words in found if words]


def _quantities(summary: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    """The computed quantities that the summary knows, of several contacts those of each."""
    units, contacts = summary.get("units", {}), summary["contacts"]
    for key, item in of_result((), units).items():
        if item.compute is None or item.detail:
            continue
        of_each = item.of == "contact" and len(contacts) != 1
        told = [
            value_in_words(item, entry[key], entry.get(f"{key}_at"))
            + (f" on {entry['name']}" if of_each else "")
            for entry in (contacts if of_each else [summary])
            if entry.get(key) is not None and entry.get(item.beside or key) is not None
        ]
        if told:
            yield item.name, ", ".join(told)


def _if_known(
    entry: Mapping[str, Any] | None, key: str, words: Callable[[Mapping[str, Any]], str]
) -> str | None:
    """An entry in words, or the reason why its key is unknown; None if nobody asks for it."""
    if entry is None:
        return None
    return str(entry["reason"]) if entry[key] is None else words(entry)


def _critical_friction(found: Mapping[str, Any]) -> str:
    mu = "" if found["coefficient"] is None else f", the coefficient {found['coefficient']:.4g}"
    return (
        f"{found['share']:.4g} times the given friction{mu}: there the linearised problem is "
        "singular"
    )


def value_in_words(quantity: Quantity, value: Any, place: Sequence[float] | None = None) -> str:
    """A value of a quantity in words, with the label of its unit and its place if it has some."""
    if quantity.share_of:
        return f"{per_cent(value)} of {quantity.share_of}"
    words = _vector(value) if isinstance(value, list) else f"{value:.4g}"
    if quantity.unit not in ("1", QUANTITIES[quantity.key].unit):
        words = f"{words} {quantity.unit}"
    return words if place is None else f"{words} {quantity.at} {_vector(place)}"


def _several(found: Mapping[str, Any] | None) -> str | None:
    return None if found is None else f"{found['found']}; {found['missing']}"


def _branch(found: Mapping[str, Any] | None) -> str | None:
    if found is None:
        return None
    shares = ", ".join(f"{share:.4g}" for share in found["folds"])
    folds = f"turns at the shares {shares}" if shares else "no turn was found"
    count = len(found["points"]["share"])
    return f"over {found['over']}: {count} points; {folds}; it ends: {found['end']}"


def equilibria(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The table of several solutions of one problem; none without them."""
    found = summary.get("equilibria")
    if not found:
        return []
    head = ("equilibria", "contact force", "friction force", "elastic energy", "index")
    rows = [
        (
            entry["folder"],
            *(_vector(entry[key] or ()) for key in _FORCES),
            f"{entry['elastic_energy']:.4g}",
            f"{entry['index']:+d}",
        )
        for entry in found["solutions"]
    ]
    return [head, *rows]


def sensitivities(summary: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The table of derivatives, the numbers that matter most first; none without derivatives."""
    found = summary.get("sensitivities")
    if not found:
        return []
    rows: list[tuple[str, ...]] = []
    for quantity, entries in found.items():
        by_size = sorted(entries.items(), key=lambda item: -abs(item[1]["elasticity"] or 0.0))
        for key, entry in by_size:
            elasticity = entry["elasticity"]
            none = str(entry.get("reason", ""))
            share = none if elasticity is None else f"{elasticity:+.3g} % for 1 %"
            checked = entry.get("checked")
            told = "" if checked is None else f"by solves {checked:.4g}"
            rows.append((f"d {quantity}/d {key}", f"{entry['derivative']:.4g}", share, told))
    return rows


def _may_adapt(summary: Mapping[str, Any]) -> bool:
    """Whether meshes are adapted: not in steps, or of boxes."""
    element = summary.get("discretisation") or {}
    return not (summary.get("steps") or element.get("cells") == "box")


def _weaknesses(summary: Mapping[str, Any]) -> Iterable[Weakness]:
    if (mesh := _relative(summary, "mesh")) is not None:
        words = f"the error of the mesh is about {_roughly(mesh)}, by an estimate"
        adapt = ", or the section adapt" if _may_adapt(summary) else ""
        yield Weakness(mesh, words, f"a finer mesh{adapt}")
    measured, bound = _relative(summary, "penalty_measured"), _relative(summary, "penalty")
    if measured:
        words = f"the penalty changes the solution by {per_cent(measured)}, as measured"
        yield Weakness(measured, words, "a larger penalty.n, or none")
    elif measured is None and bound:
        words = f"the penalty changes the solution by at most {per_cent(bound)}, by a proved bound"
        if _has_friction(summary):
            words += " for the friction bound reached"
        if bound > 1.0:
            words = f"{NOT_USEFUL} what the penalty changes"
        advice = "certificate.limit: true, which measures the change, or a larger penalty.n"
        yield Weakness(bound, words, advice)


def _relative(summary: Mapping[str, Any], name: str) -> float | None:
    return number(look_up(summary, f"certificate.errors.{name}.relative"))


def _has_friction(summary: Mapping[str, Any]) -> bool:
    """Whether friction acts, or would if there were a pressure."""
    coefficient = look_up(summary, "certificate.constants.friction_coefficient")
    return bool(coefficient) or summary.get("friction_used") is not None


def _vector(values: Iterable[float], largest: float = 0.0) -> str:
    """The vector, with zero for components that rounding alone keeps from zero.

    ``largest`` is the largest of the numbers that the vector is computed from, if that is known.
    """
    given = list(values)
    least = 1e-12 * max(map(abs, given), default=0.0)
    least = max(least, 1e-14 * largest)
    shown = [0.0 if abs(value) < least else value + 0.0 for value in given]
    return "(" + ", ".join(f"{value:.4g}" for value in shown) + ")"


def _tools(contacts: Iterable[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """How the forces on each free foundation have moved it."""
    found = []
    for entry in contacts:
        if tool := entry.get("tool"):
            told = [f"moved by {tool['travel']:.6g} along {_vector(tool['direction'])}"]
            if tool["force"] or "spring_force" not in tool:
                told.append(f"pushed by {tool['force']:.6g}")
            if "spring_force" in tool:
                told.append(f"spring force {tool['spring_force']:.6g}")
            found.append((f"foundation on {entry['name']}", ", ".join(told)))
    return found


def _reactions(summary: Mapping[str, Any]) -> str:
    reactions = summary["reactions"]
    each = [entry.get(key) for entry in (summary, *summary["contacts"]) for key in _FORCES]
    forces = [*filter(None, each), *reactions.values()]
    largest = max((abs(value) for force in forces for value in force), default=0.0)
    parts = [f"{_vector(force, largest)} on {name}" for name, force in reactions.items()]
    return ", ".join(parts)


def _criteria(criteria: Mapping[str, Mapping[str, Any]]) -> str:
    """The criteria that fail; if all hold, the one nearest to its limit."""
    failed = [
        f"{_spaced(name)} {entry['value']:.1e}, above {entry['limit']:g}"
        for name, entry in criteria.items()
        if not entry["holds"]
    ]
    if failed:
        return f"{len(failed)} of {len(criteria)} fail: {'; '.join(failed)}"
    name, entry = max(criteria.items(), key=lambda item: item[1]["value"] / item[1]["limit"])
    share = per_cent(entry["value"] / entry["limit"])
    return f"all {len(criteria)} hold; nearest to its limit: {_spaced(name)}, at {share} of it"


def _proved(summary: Mapping[str, Any]) -> str:
    bounds = summary["bounds"]
    reached = ", for the friction bound reached" if _has_friction(summary) else ""
    broken = [_spaced(name) for name, entry in bounds.items() if entry["holds"] is False]
    if broken:
        return f"violated: {', '.join(broken)}"
    held = sum(entry["holds"] is True for entry in bounds.values())
    parts = []
    if (whole := _relative(summary, "guaranteed")) is not None:
        parts.append(_at_most("the whole error is", whole, "the whole error", reached))
    if distance := _relative(summary, "penalty"):
        parts.append(_at_most(_CHANGE, distance, "what the penalty changes", reached))
    if held:
        parts.append(f"{count(held, 'bound')} of the theory, which the result keeps")
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


def _estimated(summary: Mapping[str, Any]) -> str:
    mesh, measured = _relative(summary, "mesh"), _relative(summary, "penalty_measured")
    parts = [] if mesh is None else [f"the error of the mesh is about {_roughly(mesh)}"]
    if measured is not None:
        parts.append(f"measured: {_CHANGE} {per_cent(measured)}")
    return "; ".join(parts) or "no estimate applies"


def _roughly(share: float) -> str:
    """An estimate, of which no third digit is known."""
    return f"{100.0 * share:.2g} %" if share < 1.0 else per_cent(share)


def _weakest(summary: Mapping[str, Any]) -> str:
    weak = weakest(summary)
    if weak is None:
        return "not known"
    return f"{weak.words}; it takes {weak.advice}" if weak.is_rough else weak.words


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


def _spaced(name: str) -> str:
    return name.replace("_", " ")
