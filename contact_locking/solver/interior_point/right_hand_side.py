"""The right-hand side of the tangent: forces on the nodes and on the tools."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.family import Reaction


class RightHandSide:
    """Nodal forces, and a force along the travel of each tool, which all ranks have.

    ``vector`` holds the nodal forces, and belongs to this object.
    """

    def __init__(self, system: PenalisedSystem, vector: PETSc.Vec) -> None:
        self._system = system
        #: The nodal forces.
        self.on_nodes = vector
        #: The forces along the travels of the tools, (T,).
        self.on_tools: FloatArray = np.zeros(len(system.tools))

    def start(self, forces: PETSc.Vec | None = None, share: float = 0.0) -> None:
        """Take nodal forces, or none, and a share of the forces that push the tools."""
        if forces is None:
            self.on_nodes.set(0.0)
        else:
            forces.copy(self.on_nodes)
        self.on_tools = share * np.array([tool.force for tool in self._system.tools])

    def add(self, reactions: Sequence[Reaction]) -> float:
        """Add reactions, and leave out the forces at held dofs; collective.

        Returns the norm of all nodal forces, those at held dofs among them.
        """
        self.add_all(reactions)
        every = float(self.on_nodes.norm())
        self._system.constraints.keep_free(self.on_nodes)
        return every

    def add_all(self, reactions: Sequence[Reaction]) -> None:
        """Add reactions, with the forces at held dofs; collective."""
        for reaction in reactions:
            reaction.add_to(self.on_nodes)
        if self._system.tools:
            local = np.zeros_like(self.on_tools)
            for reaction in reactions:
                reaction.family.add_tool_forces(reaction.values, local)
            self.on_tools = self.on_tools + self._system.comm.allreduce(local)

    def scale(self, factor: float) -> None:
        """Multiply all forces."""
        self.on_nodes.scale(factor)
        self.on_tools *= factor

    def norm(self) -> float:
        """The norm of the nodal forces; collective."""
        return float(self.on_nodes.norm())

    def destroy(self) -> None:
        """Free the vector; collective."""
        self.on_nodes.destroy()
