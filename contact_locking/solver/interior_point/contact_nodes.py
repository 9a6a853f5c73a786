"""The nodes of one part of Gamma_C at which contact and friction act."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.problem.contact import Contact
from contact_locking.problem.system import PenalisedSystem

Scalar = TypeVar("Scalar", bound=np.generic)


class ContactNodes:
    """``v -> v_nu`` and ``v -> v_tau`` at k nodes with weights, and the forces of tractions there.

    The nodes are the owned ones of ``contact`` whose normal displacement is free, as nothing is
    left to decide at the others.  ``number`` is the place of the contact among all contacts.
    Vectors are (d, k), scalars (k,); ``weights`` (k,) are those of the nodes.
    """

    def __init__(self, contact: Contact, number: int, system: PenalisedSystem) -> None:
        self.contact, self.number = contact, number
        self.comm, self.dim = system.comm, system.dim
        space = system.u.function_space
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        surface, self._active = contact.surface, contact.free
        self._normal = np.ascontiguousarray(contact.normals[self._active].T)
        self._nodes, self._blocks = surface.nodes[self._active], surface.blocks[self._active]
        self.weights = surface.weights[self._active]

    @property
    def gap(self) -> FloatArray:
        """The gap (k,)."""
        return self.contact.gaps[self._active]

    def normal_displacements(self, displacement: FloatArray) -> FloatArray:
        """``u_nu`` (k,) of a displacement (owned values)."""
        return np.einsum("ik,ik->k", self._nodal(displacement), self._normal)

    def slips(self, displacement: FloatArray) -> FloatArray:
        """``u_tau`` (d, k) of a displacement (owned values)."""
        return self._tangential(self._nodal(displacement))

    def old_slips(self) -> FloatArray:
        """``u_{k-1,tau}`` (d, k), where the nodes stood before the step."""
        return self.contact.memory.tangential[self._active].T

    def increments(self, displacement: FloatArray) -> FloatArray:
        """The slips (d, k) of the step, ``u_tau - u_{k-1,tau}``, of a displacement."""
        return self._tangential(self._nodal(displacement) - self.old_slips())

    def _tangential(self, values: FloatArray) -> FloatArray:
        # Once more, as rounding leaves a normal part that the stiffness of sticking enlarges.
        for _ in range(2):
            values = values - np.einsum("ik,ik->k", values, self._normal) * self._normal
        return values

    def add_pressure(self, pressure: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int p (.)_nu``."""
        self.add_traction(pressure * self._normal, forces)

    def add_traction(self, traction: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int traction . (.)``."""
        # PETSc keeps the norm of a vector until the array is given back.
        with forces as values:
            values.reshape(-1, self.dim)[self._blocks] += (self.weights * traction).T

    def stiffer_than(self, stiffness: float, springs: FloatArray) -> IndexArray:
        """The nodes, as blocks, that springs (k,) per area hold more stiffly than a material."""
        spacing = self.weights ** (1.0 / (self.dim - 1))
        return self._blocks[springs * spacing > stiffness]

    def at_all(self, values: FloatArray) -> FloatArray:
        """Values (k,) as values at all owned nodes of the contact, zero at the others."""
        result = np.zeros(len(self._active))
        result[self._active] = values
        return result

    def of_all(self, values: FloatArray) -> FloatArray:
        """The values (k,) at these nodes, from values at all owned nodes of the contact."""
        return np.asarray(values[self._active])

    def enter(self, values: npt.NDArray[Scalar], into: npt.NDArray[Scalar]) -> None:
        """Put values (k,) or (d, k) into an array over all owned nodes of the contact."""
        into[self._active] = values.T

    def scalar(self) -> fem.Function:
        """A function that :meth:`set_values` gives values (k,)."""
        return fem.Function(self.contact.surface.scalar_space)

    def vector(self) -> fem.Function:
        """A function that :meth:`set_values` gives values (d, k)."""
        return fem.Function(self.contact.surface.vector_space)

    def set_values(self, function: fem.Function, values: FloatArray) -> None:
        """Give a function its values at the nodes; collective."""
        if values.ndim == 1:
            function.x.array[self._nodes] = values
        else:
            function.x.array.reshape(-1, self.dim)[self._blocks] = values.T
        function.x.scatter_forward()

    @property
    def ds(self) -> ufl.Measure:
        return self.contact.surface.ds

    def _nodal(self, displacement: FloatArray) -> FloatArray:
        return displacement[: self._owned].reshape(-1, self.dim)[self._blocks].T
