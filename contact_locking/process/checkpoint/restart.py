"""A restart: a saved state in place of a solve, or as the start of one."""

from __future__ import annotations

from pathlib import Path

from contact_locking.certificate.energy import EnergyBalance
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import is_solved
from contact_locking.errors import InputError
from contact_locking.process.checkpoint.stored import Checkpoint, SavedStep, read
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.solver.task import Counts, Outcome, SolverReport
from contact_locking.study.assembly import StudyProblem


def solved_already(
    saved: Checkpoint, problem: StudyProblem, solver: ProblemSolver
) -> SolverReport | None:
    """The report if the saved state is the solution of the problem, otherwise None; collective.

    It has to meet the criteria of the certificate again.
    """
    if not saved.is_solution:
        return None
    state = _in_place(saved, problem, solver)
    if is_solved(state):
        return state.report
    solver.system.clear()
    return None


def start_in_words(directory: str | Path, report: SolverReport) -> str:
    """How a solve has used the state that was saved in a folder, in words."""
    if not report.from_saved:
        return f"from nothing, as the state in {directory} is too far away"
    if report.tangents == 0:
        return f"the state in {directory} meets every criterion, nothing was left to do"
    return f"from the state in {directory}"


def restored_step(
    path: Path, problem: StudyProblem, solver: ProblemSolver
) -> tuple[SolvedState, SavedStep, EnergyBalance]:
    """The step that was saved in ``path``, to which the problem is put; collective.

    Raises InputError for a checkpoint that is not of a converged step with these contacts, and the
    errors of `stored.read`.
    """
    saved = read(path, problem)
    if saved.step is None or not saved.converged:
        raise InputError(
            f"{path} is no checkpoint of a step that has converged, with the same contacts; a "
            "process starts from the last step of a process"
        )
    problem.advance(saved.step.time)
    solver.begin()
    row = saved.step.history.rows[-1]
    state = _in_place(saved, problem, solver, int(row["tangents"]), int(row["linear"]))
    return state, saved.step, EnergyBalance.of_row(row)


def _in_place(
    saved: Checkpoint,
    problem: StudyProblem,
    solver: ProblemSolver,
    tangents: int = 0,
    linear: int = 0,
) -> SolvedState:
    """The saved state in place of what the solver would find, and what it took; collective."""
    saved.state.enter(solver.system)
    # The travel of a foundation, which is part of the state, changes what slips refer to.
    if saved.step is not None:
        saved.step.enter(problem.contacts)
    solver.system.bounds.enter(problem.contacts, saved.bounds)
    found, counts = Outcome(saved.multipliers), Counts(tangents, linear)
    return solver.state(SolverReport.solved(found, counts, from_saved=True))
