"""Folders of results for the tests of reports, as `run` and `study` leave them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from solutions import of_kind

from contact_locking import __version__, study_file
from contact_locking.running import run as writing
from contact_locking.view import report

TITLE = "<script>document.title = 'run'</script> & \"$x_1\" Käfer"
STUDY = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
friction: {smoothing: {radius: 0.6}}
study: {vary: {friction.coefficient: [0.1, 0.2], penalty.n: [1.0e2, 1.0e3, 1.0e4, .inf]}}
"""
REASON = "was <img src=x onerror=alert(1)> killed by SIGKILL\u2028perhaps"

#: For tests of what a page says, which do without rendered charts.
quick = pytest.mark.usefixtures("unrendered")


def run_folder(
    folder: Path, dim: int = 2, kind: str = "locked", picture: bool = False, **summary: Any
) -> Path:
    """The folder of a run of one of the kinds of solutions, with changes of its summary."""
    wanted = {"fields": False, "picture": picture, "directory": "r"}
    entries = {
        "title": TITLE,
        "version": __version__,
        "iterations": {"tangents": 20, "linear": 69, "friction": 18},
        "stages": [{"n": float("inf"), "epsilon": 0.0, "tangents": 20}],
        "warnings": ["R hardly <i>smooths</i>"],
        **summary,
    }
    solution = of_kind(dim, kind, title=TITLE, output=wanted).telling(**entries)
    writing.write(solution, folder)
    return folder


def rows() -> list[dict[str, Any]]:
    """The rows of a study whose penetration is mu/n, and of which one case was killed."""
    cases = [(mu, n) for mu in (0.1, 0.2) for n in (1e2, 1e3, 1e4, float("inf"))]
    table: list[dict[str, Any]] = [
        {
            "friction.coefficient": mu,
            "penalty.n": n if n < float("inf") else "inf",
            "case": f"{index:016x}",
            "state": "converged",
            "converged": True,
            "reason": "every criterion held",
            "penetration_max": mu / n,
            "contact_force.0": 3.0 * (1 + 1 / n),
            "contact_force.1": 4.0 * (1 + 1 / n),
            "dofs": 290,
            "version": __version__,
        }
        for index, (mu, n) in enumerate(cases)
    ]
    table[5] = dict.fromkeys(table[5]) | {
        **{key: table[5][key] for key in ("friction.coefficient", "penalty.n", "case")},
        **{"state": "failed", "converged": False, "reason": REASON},
    }
    return table


def study_folder(
    folder: Path, table: list[dict[str, Any]] | None = None, study: str = STUDY
) -> Path:
    """The folder of a study with the rows of a table."""
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / "source.yml"
    source.write_text(f"title: {json.dumps(TITLE)}\n{study}", encoding="utf-8")
    parameters = study_file.load(source).parameters
    source.unlink()
    (folder / "parameters.yaml").write_text(study_file.dump(parameters), encoding="utf-8")
    lines = [f"{json.dumps(row, ensure_ascii=False)}\n" for row in table or rows()]
    (folder / "table.jsonl").write_text("".join(lines), encoding="utf-8")
    return folder


def page(folder: Path) -> str:
    """The page that is written into a folder of results."""
    return report.write(folder)[-1].read_text(encoding="utf-8")


LARGE = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
friction: {smoothing: {radius: 0.6}}
study:
  vary:
    friction.coefficient: [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5]
    penalty.n: [1.0e2, 1.0e3, 1.0e4, 1.0e5, 1.0e6, .inf]
"""
_REASONS = (
    "the friction bound still changes by 3.1e-02 of itself after 100 updates, contraction factor "
    "0.98; the residual is 2.3e-05 and the tolerance 1e-08",
    "was killed by SIGKILL, perhaps for want of memory",
    "infeasible: no admissible field on this mesh has the prescribed displacements; 83 % of them "
    "can be followed, and the place that prevents more is near (0.98, 0.02)",
)
_WARNING = (
    "friction.smoothing.radius: 0.01 is smaller than the mesh size 0.02 on bottom, so R hardly "
    "smooths; refine the mesh there or enlarge the radius"
)


def many_rows() -> list[dict[str, Any]]:
    """60 cases with the columns of a study: 37 converged, 15 not converged, 8 failed."""
    coefficients = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5)
    cases = [(mu, n) for mu in coefficients for n in (1e2, 1e3, 1e4, 1e5, 1e6, float("inf"))]
    table: list[dict[str, Any]] = []
    for index, (mu, n) in enumerate(cases):
        bad = index >= 30 and index % 10 > 2
        bad = bad or index in (7, 29)
        state = "converged" if not bad else "failed" if index % 3 == 1 else "not converged"
        row: dict[str, Any] = {
            "friction.coefficient": mu,
            "penalty.n": n if n < float("inf") else "inf",
            "case": f"{index:016x}",
            "state": state,
            "converged": not bad,
            "reason": _REASONS[index % 3] if bad else "every criterion held",
            "suggestion": "Take solver.method: interior_point, which needs no contraction."
            if bad
            else "",
        }
        if state != "failed":
            row |= {
                "dofs": 6024,
                "cells": 5822,
                "ranks": 1,
                "dolfinx": "0.9.0",
                "compliance": 0.01 * (1 - 0.2 * mu) * (1 + 1 / n),
                "elastic_energy": 0.003 * (1 - 0.1 * mu),
                "strain_norm_max": 0.02 * (1 + 10 / n),
                "locked_fraction": 0.198 - 0.02 * mu,
                "penetration_max": 0.01 / n,
                "contact_force.0": 0.0,
                "contact_force.1": 0.0065 * (1 + mu / n),
                "friction_force.0": -0.0044 * mu,
                "friction_force.1": 0.0,
                "contact_area": 0.8,
                "slip_area": 0.37 / (1 + mu),
                "iterations.tangents": 21 + index % 7,
                "residual": 1e-10,
                "certificate.errors.mesh.relative": 0.039 if mu < 1 else 0.31,
                "certificate.errors.penalty.relative": min(1.0, 4.0 / n),
                "warnings": _WARNING if index % 10 == 4 else "",
                "wall_seconds": 2.1,
                "version": __version__,
            }
        table.append(row)
    return table
