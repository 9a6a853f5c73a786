"""The travels of tools in the linear systems of Newton's method."""

from __future__ import annotations

from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.linear.border import Border


class ToolBorder:
    """Solves ``(K - B B^T/c) y = f``, the tangent of (25) where tools travel to their equilibrium.

    K is the tangent with tools that stand still, and a tool travels by ``-B^T y/c`` (ToolBalance).
    """

    def __init__(self, system: PenalisedSystem, ksp: PETSc.KSP, matrix: PETSc.Mat) -> None:
        self._system, self._ksp = system, ksp
        self._border = Border(len(system.tools), matrix.createVecRight)

    def refresh(self) -> None:
        """Take the tangent of the system at its present displacement; collective."""
        system, corner = self._system, []
        if not system.tools:
            return
        # The tangent has this stiffness beside that of the contact law.
        floor = system.CONTACT_FLOOR / float(system.data.epsilon.value)
        floor *= float(system.held_by_contact)
        for balance, column in zip(system.tools.balances, self._border.columns, strict=True):
            tractions, entry = balance.border(system.u, floor)
            forces: FloatArray = balance.tool.contact.surface.nodal_forces(tractions)
            column.array_w[:] = system.constraints.free_part(forces[: column.getLocalSize()])
            corner.append(entry)
        self._border.refresh(corner, self._ksp.solve)

    def solve(self, f: PETSc.Vec, y: PETSc.Vec) -> None:
        """Solve for y; collective."""
        self._ksp.solve(f, y)
        self._border.solve(y, [0.0] * len(self._system.tools))

    def destroy(self) -> None:
        """Free the PETSc objects, and the reference to the solver; collective."""
        self._border.destroy()
        self._ksp.destroy()
