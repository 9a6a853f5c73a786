"""The derivatives of a solution, of which nothing is made before somebody asks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.errors import InputError, NoDerivatives
from contact_locking.inverse.central_path import penalised_iterate
from contact_locking.inverse.derivatives import Derivatives
from contact_locking.inverse.equations import require_settled
from contact_locking.inverse.fields import field
from contact_locking.inverse.parameters import Frozen, Number, entries, number, refresh
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.system import PenalisedSystem
from contact_locking.script_names import script_names
from contact_locking.solver.task import Settings, SolverReport, Target, Task


def require_derivatives(settings: Settings) -> None:
    """Raise NoDerivatives for settings with which solutions have none."""
    if settings.linear != "direct":
        raise NoDerivatives(
            "derivatives take a factorisation, for which this body is too large by the choice of "
            "auto; take direct",
            "solver.linear",
        )


class LazyDerivatives:
    """The derivatives of the solution of a report, until :meth:`close`; collective."""

    def __init__(
        self,
        problem: DiscreteProblem,
        system: PenalisedSystem,
        target: Callable[[], Target],
        settings: Settings,
        report: SolverReport,
    ) -> None:
        self._problem, self._system, self._target = problem, system, target
        self._settings, self.report = settings, report
        self._made: Derivatives | None = None
        self._is_closed = False

    @script_names()
    def derivative(self, quantity: str, of: Any) -> Any:
        """As :meth:`contact_locking.results.solution.Solution.derivative`."""
        match of:
            case fem.Constant():
                found = np.array([self.made.by(quantity, entry) for entry in entries(of)])
                return found.reshape(np.shape(of.value)) if np.ndim(of.value) else float(found[0])
            case fem.Function():
                return field(self.made, quantity, of)
            case Number():
                return self.made.by(quantity, number(of))
        raise InputError(
            "a derivative is by a constant or a function of DOLFINx or by a Number, not by "
            f"{type(of).__name__}",
            "of",
        )

    @property
    def made(self) -> Derivatives:
        """The derivatives themselves.  Raises InputError for a solution that has none."""
        if self._is_closed:
            raise InputError(
                "the problem has been solved again, or closed, since this solution: ask for its "
                "derivatives before"
            )
        require_derivatives(self._settings)
        for contact in self._problem.contacts:
            frame = contact.surface.frame
            if frame is not None and frame.displacement is not None:
                raise NoDerivatives(
                    "derivatives do not see how the bodies that touch turn their normals as they "
                    "deform; take pair: once",
                    f"{contact.key}.pair",
                )
        if not self.report.converged:
            raise InputError("a solve that has not converged has no derivatives")
        if self._made is None:
            # Data that have changed since are told from the equations, which they change.
            refresh(self._problem, self._system)
            system, target = self._system, self._target()
            tolerance = self._settings.tolerance
            iterate = self.report.last
            if iterate is None and self.report.multipliers is not None:
                raise InputError(
                    "a solution that was read from a checkpoint has no last iterate, by which it "
                    "would be differentiated: solve it anew"
                )
            # Newton's method has the last word where there are no multipliers.
            if iterate is None or self.report.multipliers is None:
                require_settled(system, tolerance)
                iterate = penalised_iterate(system, target, tolerance)
            frozen = Frozen(self._problem, system, self._target, iterate)
            self._made = Derivatives(frozen, Task(system, target, self._settings))
        return self._made

    def close(self) -> None:
        """Destroy the PETSc objects."""
        self._is_closed = True
        if self._made is not None:
            self._made.destroy()
            self._made = None

    def __del__(self) -> None:
        # The garbage collector clears the contexts of PETSc's objects before PETSc destroys these.
        if self._problem.domain.comm.size == 1 and not PETSc.Sys.isFinalized():
            self.close()
