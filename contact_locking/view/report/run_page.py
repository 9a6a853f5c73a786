"""The page of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from contact_locking.results.contact_points import STATE_NAMES, ContactPoints
from contact_locking.results.in_words import weakest
from contact_locking.results.names import PARAMETERS
from contact_locking.results.quantities import Quantity, by_name, look_up, of_result
from contact_locking.results.read import RunResults
from contact_locking.study_file import source

from .charts import Chart
from .history_charts import Process, history_charts, wanted_charts
from .pictures import picture
from .run_charts import (
    adapt_charts,
    adapted,
    branch_charts,
    contact_charts,
    derivative_charts,
    fit_chart,
    rows_of_derivatives,
)
from .templates import render
from .words import MEANINGS, shown


class Part(NamedTuple):
    """``judged`` are entries with ``value`` and ``holds``, ``others`` all other values, by name."""

    title: str
    judged: dict[str, Any]
    others: dict[str, Any]


def certificate(summary: Mapping[str, Any]) -> list[Part]:
    """The parts of a summary's certificate that hold anything, whatever their names."""
    found = []
    parts = summary.get("certificate", {"bounds": summary.get("bounds")})
    for name, part in parts.items() if isinstance(parts, dict) else ():
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


_INFEASIBLE = "infeasible: "
# The keys of a summary about the work of the solver.
_OF_SOLVER = (
    *("cells", "dofs", "discretisation", "penalty", "iterations", "friction_fixed_point"),
    *("residual", "duality_gap", "admissible_load_factor", "wall_seconds"),
)


def run_page(run: RunResults) -> tuple[str, list[Chart]]:
    """The HTML document of a run and its charts."""
    summary = run.summary
    charts, adapt = contact_charts(run), adapt_charts(run)
    contacts, units = [*by_name(summary.get("contacts", []))], summary.get("units", {})
    wanted = look_up(source.read(run.folder / PARAMETERS).data, "output.charts") or []
    steps = wanted_charts(wanted, [Process(run.history)], "", contacts, units)
    steps += history_charts(run.history, contacts, units)
    stages = summary.get("stages", [])
    contact_quantities = _by_contact(summary)
    parts, numbers = certificate(summary), _quantities(summary)
    holds = [entry["holds"] for part in parts for entry in part.judged.values()]
    branches, derivatives = branch_charts(summary.get("branches")), rows_of_derivatives(summary)
    derived = derivative_charts(derivatives)
    fit_charts = [] if run.fit is None else [fit_chart(run.fit)]
    html = render(
        "run.html.j2",
        title=shown(summary.get("title") or "Run"),
        warnings=summary.get("warnings", []),
        quantities=[row for row in numbers if not row[0].detail],
        details=[row for row in numbers if row[0].detail],
        internals=dict(_flat({key: summary[key] for key in _OF_SOLVER if key in summary})),
        contact_names=contacts,
        contact_quantities=contact_quantities,
        contact=run.contact,
        states=_states(run.contact),
        contact_charts=charts,
        history_charts=steps,
        steps=summary.get("steps"),
        derivatives=derivatives,
        derivative_charts=derived,
        branch=summary.get("branches"),
        branch_charts=branches,
        trust=look_up(summary, "share_at_change.in_words"),
        fit=run.fit,
        fit_charts=fit_charts,
        adapted=adapted(summary),
        adapt=summary.get("adapt"),
        adapt_charts=adapt,
        certificate=parts,
        judged=(holds.count(True), holds.count(False)),
        meanings=MEANINGS,
        restart=summary.get("restart"),
        parameter_file=run.parameters,
        made_by=summary.get("version"),
        dolfinx=summary.get("dolfinx"),
        ranks=summary.get("ranks"),
        fingerprint=summary.get("fingerprint"),
        weakness=weakest(summary),
        **_verdict(summary),
        **_picture(run),
        stages=stages,
        stage_columns=list(dict.fromkeys(name for stage in stages for name in stage)),
    )
    drawn = [chart for _, group in charts for chart in group]
    return html, [*drawn, *adapt, *steps, *branches, *derived, *fit_charts]


def _verdict(summary: Mapping[str, Any]) -> dict[str, Any]:
    converged, reason = summary["converged"], summary.get("reason")
    text = shown(reason or ("" if converged else "no reason is given"))
    return {
        "converged": converged,
        "infeasible": text.startswith(_INFEASIBLE),
        "reason": text.removeprefix(_INFEASIBLE),
        "way_out": summary.get("suggestion"),
    }


def _picture(run: RunResults) -> dict[str, str | None]:
    """The picture as a data URI, or the reason why there is none."""
    if run.picture is None:
        reason = "None was drawn; output.picture is false, or the log has the reason."
        return {"picture": None, "no_picture": reason}
    reason = f"{run.picture.name} cannot be read as a picture."
    return {"picture": picture(run.picture), "no_picture": reason}


# A quantity, and its values with their places.
_Row = tuple[Quantity, list[tuple[Any, Any]]]


def _quantities(summary: Mapping[str, Any]) -> list[_Row]:
    several = len(summary.get("contacts", [])) > 1
    units = summary.get("units", {})
    found = [
        (quantity, [(value, summary.get(f"{key}_at"))])
        for key, quantity in of_result((), units).items()
        if quantity.of != "solver" and (value := look_up(summary, key)) is not None
        # The table of contacts has those of each.
        if not (several and quantity.of == "contact")
    ]
    reactions, meaning = summary.get("reactions", {}), "resultant of the reactions on the body"
    force = units.get("force", "force")
    return found + [
        (Quantity(f"reactions.{name}", f"reaction on {name}", meaning, force), [(value, None)])
        for name, value in reactions.items()
    ]


def _by_contact(summary: Mapping[str, Any]) -> list[_Row]:
    """Each quantity of contacts with its values for them; empty for one."""
    contacts = [entry or {} for entry in summary.get("contacts", [])]
    return [
        (quantity, [(contact.get(key), contact.get(f"{key}_at")) for contact in contacts])
        for key, quantity in of_result((), summary.get("units", {})).items()
        if len(contacts) > 1 and any(key in contact for contact in contacts)
    ]


def _states(contact: ContactPoints) -> list[str]:
    counts = np.bincount(contact.state, minlength=len(STATE_NAMES))
    return [f"{n} {name}" for n, name in zip(counts, STATE_NAMES, strict=True) if n]
