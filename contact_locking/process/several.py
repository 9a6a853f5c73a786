"""The words of a summary about several solutions of one problem."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from contact_locking.certificate.constants import is_unique
from contact_locking.files.csv_file import csv_text
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results.solution import StudySolution
from contact_locking.solver.equilibria.diagram import NO_START, Diagram, DiagramPoint
from contact_locking.study.assembly import StudyProblem
from contact_locking.study_file.named_numbers import with_load_share

_COLUMNS = ("index", "contact_force", "friction_force", "elastic_energy", "compliance")
_NONE = "there is no other on this mesh, as kappa is below 1, and none was searched"


def folder_of(number: int) -> str:
    """The folder of solution 2, 3, ... below that of the first."""
    return f"equilibrium_{number}"


def entry(found: Sequence[StudySolution]) -> dict[str, Any]:
    """The key ``equilibria`` of summary.json.

    ``missing`` says in words that the indices prove others, where they do: where Phi is continuous
    and bounded, and regular at its fixed points, those of all solutions add up to 1.
    """
    rows = [
        {"folder": folder_of(number) if number > 1 else "."}
        | {name: solution.summary[name] for name in _COLUMNS}
        for number, solution in enumerate(found, start=1)
    ]
    total = sum(int(solution.summary["index"]) for solution in found)
    missing = _NONE if is_unique(found[0].summary) else _missing(total)
    return {"found": len(found), "solutions": rows, "missing": missing}


def branch_of_study(
    problem: StudyProblem, solver: ProblemSolver, converged: bool
) -> dict[str, Any]:
    """The key ``branches`` of summary.json, with the solution of the problem solved; collective.

    Over loads the branch begins at this solution, in a second problem whose time is their share.
    """
    given = problem.parameters.branches
    assert given is not None
    if given.is_over_friction:
        return branches_entry(given.over, solver.diagram(given.to))
    if not converged:
        return branches_entry(given.over, NO_START)
    parameters = with_load_share(problem.parameters)
    shared = StudyProblem(parameters, problem.domain, problem.element)
    shared.advance(1.0)
    shared.enter(shared.at_rest())
    other = ProblemSolver(shared, solver.settings)
    other.system.bounds.enter(shared.contacts, problem.data.bounds.at(problem.contacts))
    found = other.diagram(given.to, shared.advance)
    other.close()
    shared.close()
    return branches_entry(given.over, found)


def branches_entry(over: str, found: Diagram) -> dict[str, Any]:
    """The key ``branches`` of summary.json: the columns of branches.csv, and what they say.

    ``leaves_at`` is the share of the first fold: solutions that follow a share which grows from 0
    leave the branch there.
    """
    names = [item.name for item in dataclasses.fields(DiagramPoint)]
    points = {name: [getattr(point, name) for point in found.points] for name in names}
    leaves = found.folds[0] if found.folds else None
    return {
        "over": over,
        "end": found.end,
        "folds": found.folds,
        "leaves_at": leaves,
        "points": points,
    }


def branches_text(entry: Mapping[str, Any]) -> str:
    """branches.csv: a row for each point in the order of the branch, numbers with all digits."""
    columns = entry["points"]
    return csv_text(columns, zip(*columns.values(), strict=True))


def _missing(total: int) -> str:
    if total == 1:
        return "the indices of these solutions add up to 1, and so do those of all solutions"
    return (
        f"the indices of these solutions add up to {total}, and those of all solutions to 1: there "
        f"are {abs(total - 1)} others at least, if the friction bounds cannot grow without a limit"
    )
