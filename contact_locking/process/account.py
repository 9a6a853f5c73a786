"""The row of history.csv for a step, and the totals of a process."""

from __future__ import annotations

from typing import Any

from contact_locking.certificate.energy import EnergyBalance
from contact_locking.results.history import History, Row
from contact_locking.results.quantities import columns, components
from contact_locking.results.solution import StudySolution

#: The columns that add up over the steps, each with the column of the step.
SUMS = {
    "work_total": "work",
    "dissipated_total": "dissipated",
    "numerical_total": "numerical",
}


def row_of(
    solution: StudySolution, history: History, at: float, energy: EnergyBalance, seconds: float
) -> Row:
    """The row of history.csv for the next step."""
    summary = solution.summary
    row: dict[str, float] = {"step": len(history) + 1, "t": at} | columns(summary)
    row |= components("reaction", summary["certificate"]["resultants"]["reactions"])
    for name, force in summary["reactions"].items():
        row |= components(f"reaction_{name}", force)
    several = len(summary["contacts"]) > 1
    for number, entry in enumerate(summary["contacts"], start=1):
        ending = f"_{number}" if several else ""
        row |= columns(entry, ending) if several else {}
        for name in ("force", "travel") if "tool" in entry else ():
            row[f"tool_{name}{ending}"] = entry["tool"][name]
    row |= {
        "stored": energy.stored,
        "work": energy.work,
        "dissipated": energy.dissipated,
        "numerical": energy.numerical,
        "energy_defect": energy.defect,
    }
    row |= {total: history.last(total) + row[one] for total, one in SUMS.items()}
    criteria = summary["certificate"]["criteria"].values()
    row |= {
        "tangents": summary["iterations"]["tangents"],
        "linear": summary["iterations"]["linear"],
        "residual": summary["residual"],
        "nearest_criterion": max(entry["value"] / entry["limit"] for entry in criteria),
        "seconds": seconds,
    }
    return row


def totals(history: History, halvings: int, planned: int) -> dict[str, Any]:
    """The key ``steps`` of summary.json."""
    return {
        "solved": len(history),
        "planned": planned,
        "halvings": halvings,
        "time": history.last("t"),
        "tangents": int(sum(row["tangents"] for row in history)),
        "seconds": sum(row["seconds"] for row in history),
        "work": history.last("work_total"),
        "stored": history.last("stored"),
        "dissipated": history.last("dissipated_total"),
        "numerical": history.last("numerical_total"),
    }
