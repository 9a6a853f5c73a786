"""A step of a process as its checkpoint has it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from contact_locking.certificate.energy import EnergyBalance
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.errors import InputError
from contact_locking.process import checkpoint
from contact_locking.process.checkpoint.stored import SavedStep
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.solver.task import SolverReport
from contact_locking.study.assembly import StudyProblem


@dataclass(frozen=True)
class Restored:
    """A saved step, with its solved state in place of the solution of the problem."""

    state: SolvedState
    step: SavedStep

    @property
    def energy(self) -> EnergyBalance:
        """The energy balance of the step."""
        return EnergyBalance.of_row(self.step.history.rows[-1])


def restore(path: Path, problem: StudyProblem, solver: ProblemSolver) -> Restored:
    """Put a problem to the step that was saved in ``path``; collective.

    Raises InputError for a checkpoint that is not of a converged step with these contacts, and the
    errors of `checkpoint.read`.
    """
    saved = checkpoint.read(path, problem)
    if saved.step is None or saved.multipliers is None or not saved.converged:
        raise InputError(
            f"{path} is no checkpoint of a step that has converged, with the same contacts; a "
            "process starts from the last step of a process"
        )
    problem.advance(saved.step.time)
    solver.begin()
    saved.state.enter(solver.system)
    saved.step.enter(problem.contacts)
    for contact, bound in zip(problem.contacts, saved.bounds, strict=True):
        contact.bounds = bound
    row = saved.step.history.rows[-1]
    report = SolverReport(
        converged=True,
        reason="every criterion held",
        tangents=int(row["tangents"]),
        linear=int(row["linear"]),
        multipliers=saved.multipliers,
        from_saved=True,
    )
    return Restored(solver.state(report), saved.step)
