"""Several solutions of a `ContactProblem`: others beside the first, and branches of them."""

from __future__ import annotations

import dataclasses

from dolfinx import fem

from contact_locking.certificate.verdict import Extras
from contact_locking.contact_problem import ContactProblem
from contact_locking.results.solution import Solution
from contact_locking.script_names import in_script, script_names
from contact_locking.theory.constants import is_unique
from contact_locking.theory.equilibria.diagram import NO_START, Diagram, diagram
from contact_locking.theory.equilibria.search import equilibria as search


@script_names()
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
    problem.begin(after)
    solver = problem.solver
    report = solver.solve(None if after is None else after.state.saved)
    if not report.converged:
        return [problem.solution(report, extras)]
    solutions: list[Solution] = []
    for other in search(solver.task, report, find):
        solution = problem.solution(other.report, extras)
        solutions.append(solution.telling(index=other.index))
        if is_unique(solution.summary):
            break
    return solutions


@script_names()
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
    problem.begin(after)
    solver, load = problem.solver, None
    if over is not None:
        if not solver.solve(None if after is None else after.state.saved).converged:
            return NO_START
        whole = over.value.copy()

        def load(share: float) -> None:
            over.value = share * whole
            solver.problem.place()
            solver.system.assemble_loads()

    made = diagram(solver.task, to, load)
    return dataclasses.replace(made, end=in_script(made.end))
