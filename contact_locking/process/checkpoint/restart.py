"""A restart: the saved state is the solution, or the start of the solve, or of no use."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from contact_locking.certificate import is_solved
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.problem.system import PenalisedSystem
from contact_locking.process import checkpoint
from contact_locking.solver.multipliers import ContactForces, Multipliers
from contact_locking.solver.saved import SavedState
from contact_locking.solver.settings import Settings
from contact_locking.solver.solver_report import SolverReport
from contact_locking.solver.target import Target
from contact_locking.study.assembly import StudyProblem


class Restart:
    """The saved state of a run's folder as the solution or the start of a problem; collective."""

    def __init__(self, directory: str | Path, problem: StudyProblem) -> None:
        self._directory, self._problem = directory, problem
        self._saved = checkpoint.read(directory, problem)

    @property
    def state(self) -> SavedState:
        """The state that a solver may start from."""
        return self._saved.state

    def solved_already(
        self, system: PenalisedSystem, target: Target, settings: Settings
    ) -> SolverReport | None:
        """The report if the saved state solves the problem, otherwise None; collective.

        The saved solution of the same problem has to meet the criteria of the certificate again.
        The saved state of another problem has to meet the tolerances of a solver.
        """
        saved = self._saved
        if saved.multipliers is None:
            return None
        saved.state.enter(system)
        for contact, bound in zip(system.contacts, saved.bounds, strict=True):
            contact.bounds = bound
        report = SolverReport(
            converged=True,
            reason="every criterion held",
            multipliers=saved.multipliers,
            from_saved=True,
        )
        state = SolvedState.of(self._problem, system, target, settings, report)
        if not saved.is_solution:
            report.multipliers = _acting(state, saved.multipliers)
            state = SolvedState.of(self._problem, system, target, settings, report)
        if is_solved(state, sharply=not saved.is_solution):
            return report
        system.clear()
        return None

    def in_words(self, report: SolverReport) -> str:
        """How the solve used the saved state, in words."""
        if not report.from_saved:
            return f"from nothing, as the state in {self._directory} is too far away"
        if report.tangents == 0:
            return f"the state in {self._directory} meets every criterion, nothing was left to do"
        return f"from the state in {self._directory}"


def _acting(state: SolvedState, multipliers: Multipliers) -> Multipliers:
    """The multipliers that the laws of the problem admit, zero elsewhere; collective.

    Zero are locking stresses in cells without a limit, tractions at held nodes, and friction
    tractions on contacts without friction: no criterion except equilibrium checks these.
    """
    problem = state.problem
    forces = []
    for contact, found in zip(problem.contacts, multipliers.contacts, strict=True):
        rubs = contact.free & (not contact.friction.frictionless)
        forces.append(
            ContactForces(
                np.where(contact.free, found.pressure, 0.0),
                np.where(rubs[:, None], found.friction, 0.0),
                found.touches & contact.free,
            )
        )
    data = problem.data
    acting = Multipliers.none(data, problem.domain.mesh, tuple(forces))
    for item, part, saved in zip(data.sets, acting.parts, multipliers.parts, strict=True):
        limited = (item.inverse_limit.x.array > 0.0)[:, None]
        blocks = saved.x.array.reshape(-1, saved.function_space.dofmap.bs)
        part.x.array[:] = np.where(limited, blocks, 0.0).reshape(-1)
    acting.add_up(data)
    return acting
