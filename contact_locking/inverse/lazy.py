"""The derivatives of a solution, of which nothing is made before somebody asks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.errors import InputError, NoDerivatives
from contact_locking.inverse.derivatives import (
    Derivatives,
    Frozen,
    Number,
    entries,
    number,
    refresh,
)
from contact_locking.inverse.equations import require_settled
from contact_locking.inverse.fields import field
from contact_locking.inverse.linearisation import penalised_iterate
from contact_locking.inverse.quantities import require_quantities
from contact_locking.process.problem_solver import ProblemSolver, linear_solver
from contact_locking.script_names import script_names
from contact_locking.solver.linear.options import UserOptions
from contact_locking.solver.task import Settings, SolverReport, Task


def deriving(solver: ProblemSolver) -> Settings:
    """The settings for derivatives, which take a factorisation where the body is small."""
    settings = solver.settings
    if linear_solver(solver.problem, "auto") == "direct" and settings.linear != "direct":
        # The options are those of an iterative solver.
        return dataclasses.replace(settings, linear="direct", petsc=UserOptions({}))
    return settings


def require_derivatives(solver: ProblemSolver, names: Sequence[str] = ()) -> None:
    """Raise InputError for a problem or quantities without derivatives; needs no solve."""
    if deriving(solver).linear != "direct":
        raise NoDerivatives(
            "derivatives take a factorisation, for which this body is too large by the choice of "
            "auto; take direct",
            "solver.linear",
        )
    require_quantities(names, solver.problem.domain, solver.system)


class LazyDerivatives:
    """The derivatives of the solution of a report, until :meth:`close`; collective."""

    def __init__(self, solver: ProblemSolver, report: SolverReport) -> None:
        self._solver, self._report = solver, report
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
        require_derivatives(self._solver)
        problem, system, report = self._solver.problem, self._solver.system, self._report
        for contact in problem.contacts:
            frame = contact.surface.frame
            if frame is not None and frame.displacement is not None:
                raise NoDerivatives(
                    "derivatives do not see how the bodies that touch turn their normals as they "
                    "deform; take pair: once",
                    f"{contact.key}.pair",
                )
        if not report.converged:
            raise InputError("a solve that has not converged has no derivatives")
        if self._made is None:
            # Data that have changed since are told from the equations, which they change.
            refresh(problem, system)
            target, settings = self._solver.target, deriving(self._solver)
            tolerance = settings.tolerance
            iterate = report.last
            if iterate is None and report.multipliers is not None:
                raise InputError(
                    "a solution that was read from a checkpoint has no last iterate, by which it "
                    "would be differentiated: solve it anew"
                )
            # Newton's method has the last word where there are no multipliers.
            if iterate is None or report.multipliers is None:
                require_settled(system, tolerance)
                iterate = penalised_iterate(system, target, tolerance)
            frozen = Frozen(problem, system, lambda: self._solver.target, iterate)
            self._made = Derivatives(frozen, Task(system, target, settings))
        return self._made

    def close(self) -> None:
        """Destroy the PETSc objects."""
        self._is_closed = True
        if self._made is not None:
            self._made.destroy()
            self._made = None

    def __del__(self) -> None:
        # The garbage collector clears the contexts of PETSc's objects before PETSc destroys these.
        if self._solver.problem.domain.comm.size == 1 and not PETSc.Sys.isFinalized():
            self.close()
