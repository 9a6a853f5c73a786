"""The interface of direct and iterative solvers, which solve with one tangent after another."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from typing import Any

from petsc4py import PETSc

from contact_locking.solver.linear.filtered_multigrid import StiffPart
from contact_locking.solver.linear.ksp import IterationListener, create_ksp, destroy_ksp
from contact_locking.solver.linear.storage import Unblocked

#: Adds the forces that follow a displacement to its second argument; collective.
Follow = Callable[[PETSc.Vec, PETSc.Vec], None]
#: Gives a matrix the values of the tangent; collective.
Assemble = Callable[[PETSc.Mat], None]


class TangentSolver(abc.ABC):
    """Solves with a tangent whose values change; all of it is collective.

    ``matrix`` is where the solver may have these values assembled.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        self._matrix, self._iterations = matrix, 0

    @abc.abstractmethod
    def refresh(self, assemble: Assemble, split: Callable[[], StiffPart]) -> None:
        """The tangent has new values.

        ``assemble`` gives them to the matrix if the solver needs them there, and ``split`` tells
        which are stiff.
        """

    def multiply(self, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``y = A x`` for an x that is zero where displacements are prescribed."""
        self._matrix.mult(x, y)

    @abc.abstractmethod
    def solve(
        self, right: PETSc.Vec, step: PETSc.Vec, residual: float, is_rough: bool = False
    ) -> None:
        """Leave a residual of ``residual`` at most, starting from ``step``.

        Solves that are rough, and many, may leave more than others.  Raises NotConverged, or
        PETSc's error.
        """

    @property
    def filters(self) -> bool:
        """Whether the filter or the projection takes part at present."""
        return False

    @property
    def solves_following(self) -> bool:
        """Whether :meth:`solve_following` is there."""
        return False

    def solve_following(
        self, follow: Follow, right: PETSc.Vec, step: PETSc.Vec, residual: float
    ) -> None:
        """As :meth:`solve`, with forces that follow the displacement beside the matrix."""
        raise NotImplementedError

    @property
    def direct(self) -> PETSc.KSP | None:
        """The factorisation, if there is one, until this is destroyed.

        Other tangents that are assembled into its matrix need no symbolic factorisation.
        """
        return None

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        count, self._iterations = self._iterations, 0
        return count

    @abc.abstractmethod
    def destroy(self) -> None:
        """Free the PETSc objects."""


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
        self._unblocked.destroy()
        destroy_ksp(self._ksp)
