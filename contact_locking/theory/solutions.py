"""Several solutions of a `ContactProblem` or of a study: others beside the first, and branches."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from dolfinx import fem

from contact_locking.contact_problem import ContactProblem
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.results import output as names
from contact_locking.results.output import Extras
from contact_locking.results.solution import Solution
from contact_locking.running.assembly import StudyProblem
from contact_locking.running.solving import SolvableStudy
from contact_locking.solver.task import Outcome
from contact_locking.study_file.dump import plain
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.reading import assign
from contact_locking.theory.constants import is_unique
from contact_locking.theory.search import NO_START, Diagram, DiagramPoint, diagram
from contact_locking.theory.search import equilibria as search


def equilibria(
    problem: ContactProblem,
    find: int = 5,
    after: Solution | None = None,
    extras: Extras | None = None,
) -> list[Solution]:
    """The solution for the present data, and others beside it, ``find`` at most; collective.

    The others are on the branch of solutions over the share of friction, or found by deflation;
    each has a certificate, and the ``index`` of its summary is +1, -1 or 0.  There is one
    solution in the list if no other was found, which does not say that there is none, or if
    it has not converged.  Beside a solution that kappa proves to be unique none is searched.

    Parameters
    ----------
    problem
        a problem with Coulomb friction that more than friction holds
    find
        the most solutions, the first included
    after
        the solution of the step before, None for a static problem
    extras
        parts of each certificate that are made on request

    Raises InputError for present data that cannot be used, or where there is no map of the
    friction bounds.
    """
    report, asked = problem.report(after), extras or Extras()
    if not report.converged:
        return [problem.solver.solution(problem.solver.state(report), None, asked)]
    solutions: list[Solution] = []
    for other, index in search(problem.solver.task, report, find):
        solution = problem.solver.solution(problem.solver.state(other), None, asked)
        solutions.append(solution.with_entries(index=index))
        if is_unique(solution.summary):
            break
    return solutions


def branch(
    problem: ContactProblem,
    to: float = 2.0,
    after: Solution | None = None,
    over: fem.Constant | None = None,
) -> Diagram:
    """The solutions over the share of friction, from none up to ``to`` of it; collective.

    The branch may end before, and says why.  Nothing tells that there are no other solutions.

    Parameters
    ----------
    problem
        as for :func:`equilibria`
    to
        the last share
    after
        the solution of the step before, None for a static problem
    over
        a constant in L or of a support: the branch is then over a share of this constant, from its
        present value up or down to ``to`` times of it

    Raises InputError as :func:`equilibria`.
    """
    solver, load = problem.solver, None
    if over is None:
        problem.begin(after)
    else:
        if not problem.report(after).converged:
            return NO_START
        whole = over.value.copy()

        def load(share: float) -> None:
            over.value = share * whole
            solver.problem.update_foundations()
            solver.system.assemble_loads()

    return diagram(solver.task, to, load)


_COLUMNS = ("index", "contact_force", "friction_force", "elastic_energy", "compliance")
_NONE = "there is no other on this mesh, as kappa is below 1, and none was searched"


class SectionsOfStudy:
    """The sections ``branches`` and ``equilibria`` of a study; collective."""

    def __init__(self, study: SolvableStudy) -> None:
        self._study, self._monitor = study, study.solver.monitor

    def after(self, solution: Solution, report: Outcome) -> Solution:
        """The solution with the branch in its summary, or with others, each certified."""
        parameters, solver = self._study.parameters, self._study.solver
        if parameters.branches is not None:
            self._monitor.message("following the branch of solutions")
            branch = _branch_of_study(self._study.problem, solver, solution.converged)
            solution = solution.with_entries(branches=branch)
        if parameters.equilibria is None or not solution.converged:
            return solution
        most = 1 if is_unique(solution.summary) else parameters.equilibria.find
        solutions = [solution]
        for number, (outcome, index) in enumerate(search(solver.task, report, most)):
            if number > 0:
                self._monitor.message(f"another solution: {number + 1} so far")
                other = self._study.judged(solver.state(outcome))
                solutions.append(other.with_entries(restart=None))
            solutions[-1] = solutions[-1].with_entries(index=index)
        first = solutions[0].with_entries(equilibria=_entry(solutions))
        return dataclasses.replace(first, others=tuple(solutions[1:]))

    def close(self) -> None:
        """Nothing: the solutions are done."""


def _entry(solutions: Sequence[Solution]) -> dict[str, Any]:
    """The key ``equilibria`` of summary.json.

    ``missing`` says in words that the indices prove others, where they do: where Phi is continuous
    and bounded, and regular at its fixed points, those of all solutions add up to 1.
    """
    rows = [
        {"folder": names.folder_of(number) if number > 1 else "."}
        | {name: solution.summary[name] for name in _COLUMNS}
        for number, solution in enumerate(solutions, start=1)
    ]
    total = sum(int(solution.summary["index"]) for solution in solutions)
    if is_unique(solutions[0].summary):
        missing = _NONE
    elif total == 1:
        missing = "the indices of these solutions add up to 1, and so do those of all solutions"
    else:
        missing = (
            f"the indices of these solutions add up to {total}, and those of all solutions to 1: "
            f"there are {abs(total - 1)} others at least, if the friction bounds cannot grow "
            "without a limit"
        )
    return {"found": len(solutions), "solutions": rows, "missing": missing}


def _branch_of_study(
    problem: StudyProblem, solver: ProblemSolver, converged: bool
) -> dict[str, Any]:
    """The key ``branches`` of summary.json, with the solution of the problem solved; collective.

    Over loads the branch begins at this solution, in a second problem whose time is their share.
    The points are the columns of branches.csv.  ``leaves_at`` is the share of the first fold:
    solutions that follow a share which grows from 0 leave the branch there.
    """
    section = problem.parameters.branches
    assert section is not None
    if section.is_over_friction:
        branch = diagram(solver.task, section.to)
    elif not converged:
        branch = NO_START
    else:
        parameters = _with_load_share(problem.parameters)
        shared = StudyProblem(parameters, problem.domain, problem.element)
        shared.advance(1.0)
        shared.set_memory(shared.at_rest())
        other = ProblemSolver(shared, solver.settings)
        other.system.bounds.set(shared.contacts, problem.data.bounds.at(problem.contacts))

        def load(share: float) -> None:
            shared.advance(share)
            other.system.assemble_loads()

        branch = diagram(other.task, section.to, load)
        other.close()
        shared.close()
    columns = [field.name for field in dataclasses.fields(DiagramPoint)]
    return {
        "over": section.over,
        "end": branch.end,
        "folds": branch.folds,
        "leaves_at": branch.folds[0] if branch.folds else None,
        "points": {name: [getattr(point, name) for point in branch.points] for name in columns},
    }


def _with_load_share(parameters: Parameters) -> Parameters:
    """The study whose time t is the share of the loads that ``branches`` multiplies."""
    assert parameters.branches is not None
    data = plain(parameters)
    for section in ("branches", "sensitivities", "fit", "study", "equilibria"):
        data.pop(section, None)
    data["steps"] = {"times": sorted({1.0, parameters.branches.to})}
    for key, value in parameters.shared_loads():
        assign(data, key, f"({value})*t")
    return Parameters.model_validate(data)
