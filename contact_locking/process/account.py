"""What a step adds to the history of its process."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact_locking.arrays import AXES
from contact_locking.certificate.energy import EnergyBalance
from contact_locking.parallel import maximum
from contact_locking.results.contact_points import OPEN
from contact_locking.results.history import History, Row
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
    """The row of history.csv for the next step; collective."""
    summary, comm = solution.summary, solution.domain.comm
    row: dict[str, float] = {"step": len(history) + 1, "t": at}
    for name in ("contact_force", "friction_force"):
        row |= _vector(name, summary[name])
    row |= _vector("reaction", summary["certificate"]["resultants"]["reactions"])
    for name, force in summary["reactions"].items():
        row |= _vector(f"reaction_{name}", force)
    several = summary["contacts"] if len(solution.contacts) > 1 else []
    for number, entry in enumerate(several, start=1):
        for name in ("contact_force", "friction_force"):
            row |= _vector(f"{name}_{number}", entry[name])
    for number, entry in enumerate(summary["contacts"], start=1):
        if "tool" in entry:
            suffix = f"_{number}" if several else ""
            row[f"tool_force{suffix}"] = entry["tool"]["force"]
            row[f"tool_travel{suffix}"] = entry["tool"]["travel"]
    touching = [fields.state != OPEN for fields in solution.contacts]
    pairs = list(zip(solution.contacts, touching, strict=True))
    slips = [fields.slip[where] for fields, where in pairs]
    steps = [np.linalg.norm(fields.increment[where], axis=1) for fields, where in pairs]
    row |= {
        "contact_area": summary["contact_area"],
        "slip_area": summary["slip_area"],
        "slip_max": max((maximum(comm, values) for values in slips), default=0.0),
        "slip_step_max": max((maximum(comm, values) for values in steps), default=0.0),
        "penetration_max": summary["penetration_max"],
        "strain_norm_max": summary["strain_norm_max"],
        "locked_fraction": summary["locked_fraction"],
        "elastic_energy": summary["elastic_energy"],
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


def _vector(name: str, values: list[float]) -> dict[str, float]:
    return {f"{name}_{axis}": value for axis, value in zip(AXES, values, strict=False)}
