"""Linear solves with one tangent after another by a KSP of PETSc: direct, or as users want it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking.solver.linear.filtered_multigrid import StiffPart
from contact_locking.solver.linear.ksp import IterationListener, create_ksp, destroy_ksp
from contact_locking.solver.linear.storage import Unblocked
from contact_locking.solver.linear.tangent_solver import Assemble, TangentSolver


class KspTangents(TangentSolver):
    """Solves with the tolerances of the options, ``overrides`` before ``defaults``.

    ``is_direct`` tells that the defaults factorise.  Otherwise ``listen`` is told the number of
    each Krylov iteration.
    """

    def __init__(
        self,
        matrix: PETSc.Mat,
        defaults: Mapping[str, Any],
        overrides: Mapping[str, Any],
        is_direct: bool,
        listen: Callable[[int], None],
    ) -> None:
        super().__init__(matrix)
        self._is_direct = is_direct
        self._ksp = create_ksp(matrix.getComm(), defaults, overrides)
        self._listeners = [] if is_direct else [IterationListener(self._ksp, listen)]
        self._unblocked = Unblocked()

    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """The tangent has new values."""
        assemble(self._matrix)
        self._ksp.setOperators(self._unblocked.of(self._matrix))

    def solve(
        self, right: PETSc.Vec, step: PETSc.Vec, residual: float, is_rough: bool = False
    ) -> None:
        """Solve to the tolerances of the options."""
        self._ksp.solve(right, step)
        for listener in self._listeners:
            listener.raise_kept()
        self._iterations += self._ksp.getIterationNumber()

    @property
    def direct(self) -> PETSc.KSP | None:
        """The KSP, if the defaults factorise."""
        return self._ksp if self._is_direct else None

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self._unblocked.destroy()
        destroy_ksp(self._ksp)
