"""What a saved state is good for: being the solution, being near it, or nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from contact_locking import checkpoint
from contact_locking.certificate import is_solved
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.problem.assembly import Problem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver import SavedState, Settings, SolverReport
from contact_locking.solver.multipliers import ContactForces, Multipliers
from contact_locking.solver.target import Target


class Restart:
    """The state saved in a run's folder beside the problem that is to be solved now; collective."""

    def __init__(self, directory: str | Path, problem: Problem) -> None:
        self._directory, self._problem = directory, problem
        self._saved = checkpoint.read(directory, problem)

    @property
    def state(self) -> SavedState:
        """What a solver may go on from."""
        return self._saved.state

    def solved_already(
        self, system: PenalisedSystem, target: Target, settings: Settings
    ) -> SolverReport | None:
        """The report if the saved state solves the problem as it is, else None; collective.

        What was saved as the solution of the same problem has to meet the certificate's criteria
        again; of another problem it is a solution only if it meets the tolerances of a solver.
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

    def told(self, report: SolverReport) -> str:
        """What the saved state was good for, in words."""
        if not report.from_saved:
            return f"from nothing, as the state in {self._directory} is too far away"
        if report.tangents == 0:
            return f"the state in {self._directory} meets every criterion, nothing was left to do"
        return f"from the state in {self._directory}"


def _acting(state: SolvedState, multipliers: Multipliers) -> Multipliers:
    """The multipliers without those that the problem has no law for; collective.

    No criterion but equilibrium looks at stresses in cells without a limit, at tractions where
    displacements are prescribed, and at friction where there is none.
    """
    problem, dim = state.problem, state.dim
    stress = multipliers.locking_stress.copy()
    never_locks = problem.data.inverse_limit.x.array == 0.0
    stress.x.array.reshape(-1, dim, dim)[never_locks] = 0.0
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
    return Multipliers(stress, tuple(forces))
