"""Several solutions of a study: the sections ``equilibria`` and ``branches``, and their words."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from contact_locking.monitor import Monitor
from contact_locking.process.of_study import certified, of_study
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results import names
from contact_locking.results.solution import StudySolution
from contact_locking.solver.task import SolverReport
from contact_locking.study.assembly import StudyProblem
from contact_locking.study_file.named_numbers import with_load_share
from contact_locking.theory.constants import is_unique
from contact_locking.theory.equilibria.diagram import NO_START, Diagram, DiagramPoint, diagram
from contact_locking.theory.equilibria.search import equilibria

_COLUMNS = ("index", "contact_force", "friction_force", "elastic_energy", "compliance")
_NONE = "there is no other on this mesh, as kappa is below 1, and none was searched"


class Equilibria:
    """The section ``equilibria`` of a study; collective."""

    def __init__(self, problem: StudyProblem, solver: ProblemSolver, monitor: Monitor) -> None:
        self._problem, self._solver, self._monitor = problem, solver, monitor

    def after(
        self, solution: StudySolution, report: SolverReport, time: float | None
    ) -> StudySolution:
        """The solution with others, each certified, and their table in its summary."""
        given, problem = self._problem.parameters.equilibria, self._problem
        if given is None or not solution.converged:
            return solution
        most = 1 if is_unique(solution.summary) else given.find
        solutions = [solution]
        for number, item in enumerate(equilibria(self._solver.task, report, most)):
            if number > 0:
                self._monitor.message(f"another solution: {number + 1} so far")
                state = self._solver.state(item.report)
                other = of_study(problem, state, certified(problem.parameters, state))
                solutions.append(other.telling(restart=None))
            solutions[-1] = solutions[-1].telling(index=item.index)
        first = solutions[0].telling(equilibria=entry(solutions))
        return dataclasses.replace(first, others=tuple(solutions[1:]))

    def close(self) -> None:
        """Nothing: the solutions are done."""


class Branches:
    """The section ``branches`` of a study; collective."""

    def __init__(self, problem: StudyProblem, solver: ProblemSolver, monitor: Monitor) -> None:
        self._problem, self._solver, self._monitor = problem, solver, monitor

    def after(
        self, solution: StudySolution, report: SolverReport, time: float | None
    ) -> StudySolution:
        """The solution with the branch in its summary."""
        self._monitor.message("following the branch of solutions")
        branch = branch_of_study(self._problem, self._solver, solution.converged)
        return solution.telling(branches=branch)

    def close(self) -> None:
        """Nothing: the branch is done."""


def entry(found: Sequence[StudySolution]) -> dict[str, Any]:
    """The key ``equilibria`` of summary.json.

    ``missing`` says in words that the indices prove others, where they do: where Phi is continuous
    and bounded, and regular at its fixed points, those of all solutions add up to 1.
    """
    rows = [
        {"folder": names.folder_of(number) if number > 1 else "."}
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
        return branches_entry(given.over, diagram(solver.task, given.to))
    if not converged:
        return branches_entry(given.over, NO_START)
    parameters = with_load_share(problem.parameters)
    shared = StudyProblem(parameters, problem.domain, problem.element)
    shared.advance(1.0)
    shared.enter(shared.at_rest())
    other = ProblemSolver(shared, solver.settings)
    other.system.bounds.enter(shared.contacts, problem.data.bounds.at(problem.contacts))

    def load(share: float) -> None:
        shared.advance(share)
        other.system.assemble_loads()

    found = diagram(other.task, given.to, load)
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


def _missing(total: int) -> str:
    if total == 1:
        return "the indices of these solutions add up to 1, and so do those of all solutions"
    return (
        f"the indices of these solutions add up to {total}, and those of all solutions to 1: there "
        f"are {abs(total - 1)} others at least, if the friction bounds cannot grow without a limit"
    )
