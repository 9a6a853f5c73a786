"""The nodes of one part of Gamma_C at which contact and friction act."""

from __future__ import annotations

from abc import abstractmethod
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.fem.contact_operator import PointStiffness
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.lorentz import dot
from contact_locking.solver.interior_point.slips import along_planes

Scalar = TypeVar("Scalar", bound=np.generic)


class ContactNodes:
    """``v -> v_nu`` and ``v -> v_tau`` at k nodes with weights, and the forces of tractions there.

    The nodes are the owned ones of ``contact`` whose normal displacement is free, as nothing is
    left to decide at the others.  ``number`` is the place of the contact among all contacts.
    Vectors are (d, k), scalars (k,); ``weights`` (k,) are those of the nodes.
    """

    def __init__(self, contact: NodalContact, number: int, system: PenalisedSystem) -> None:
        self.contact, self.number = contact, number
        self.comm, self.dim = system.comm, system.dim
        surface, self._active = contact.surface, contact.free
        self.normal = np.ascontiguousarray(contact.normals[self._active].T)
        self.operator = surface.operator
        self._points = np.flatnonzero(self._active).astype(np.int32)
        self.weights = surface.weights[self._active]
        contacts = [tool.contact for tool in system.tools]
        #: The number of the foundation here among the free ones, None if it is not free.
        self.tool = contacts.index(contact) if contact in contacts else None
        none = np.zeros(self.dim)
        self._direction = none if self.tool is None else system.tools[self.tool].direction
        self._owned = len(system.load)

    @property
    def gap(self) -> FloatArray:
        """The gap (k,)."""
        return self.contact.gaps[self._active]

    def normal_displacements(self, displacement: FloatArray) -> FloatArray:
        """``u_nu`` (k,) of a displacement, relative to tools; collective."""
        return dot(self._at_points(displacement), self.normal)

    def slips(self, displacement: FloatArray) -> FloatArray:
        """``u_tau`` (d, k) of a displacement, relative to tools; collective."""
        return along_planes(self._at_points(displacement), self.normal)

    def old_slips(self) -> FloatArray:
        """``u_{k-1,tau}`` (d, k), where the nodes stood before the step."""
        return self.contact.references[self._active].T

    def increments(self, displacement: FloatArray) -> FloatArray:
        """The slips (d, k) of the step, ``u_tau - u_{k-1,tau}``, of a displacement; collective."""
        return along_planes(self._at_points(displacement) - self.old_slips(), self.normal)

    def add_traction(self, traction: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int traction . (.)``; collective."""
        self.operator.add_forces(self.at_all(self.weights * traction), forces)

    def stiffness(self, block: FloatArray) -> PointStiffness:
        """The stiffness of blocks D (d, d, k)."""
        return PointStiffness(self.operator, self.at_all(self.weights * block))

    def add_tool_forces(
        self, traction: FloatArray, forces: FloatArray, magnitudes: bool = False
    ) -> None:
        """``forces -= int traction . d`` for a travel d here, or ``+= int |traction . d|``."""
        if self.tool is not None:
            along = self._direction @ traction
            sum_of = np.abs(along) if magnitudes else -along
            forces[self.tool] += sum_of @ self.weights

    def stiffer_than(self, stiffness: float, springs: FloatArray) -> IndexArray:
        """The owned blocks that springs (k,) hold more stiffly than a material; collective."""
        return self.operator.blocks_of(self._points[springs > self.material_springs(stiffness)])

    def material_springs(self, material: float) -> FloatArray:
        """The springs (k,) per area that are as stiff as a material with this stiffness."""
        return np.asarray(material * self.weights ** (-1.0 / (self.dim - 1)))

    def along(self, places: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``v -> directions . v``, (d, p), at nodes ``places`` (p,); collective."""
        return self.operator.along(self._points[places], directions.T)

    def at_all(self, values: FloatArray) -> FloatArray:
        """Values (..., k) as values (K, ...) at all owned nodes of the contact, zero at others."""
        result = np.zeros((len(self._active), *values.shape[:-1]))
        result[self._active] = np.moveaxis(values, -1, 0)
        return result

    def of_all(self, values: FloatArray) -> FloatArray:
        """The values (k, ...) at these nodes, from those at all owned nodes of the contact."""
        return np.asarray(values[self._active])

    def enter(self, values: npt.NDArray[Scalar], into: npt.NDArray[Scalar]) -> None:
        """Put values (k,) or (d, k) into an array over all owned nodes of the contact."""
        into[self._active] = values.T

    def _at_points(self, displacement: FloatArray) -> FloatArray:
        """The limited values (d, k) of a displacement, relative to tools; collective."""
        values = self.operator.values(displacement)[self._active].T
        if self.tool is None:
            return values
        return np.asarray(values - displacement[self._owned + self.tool] * self._direction[:, None])


class OnContact(Family):
    """The common part of families of cones at the nodes of a contact."""

    nodes: ContactNodes
    #: The block D (d, d, k) that the tangent has, with the directions of vectors at the nodes.
    tangent_block: FloatArray

    @abstractmethod
    def tractions(self, reactions: FloatArray) -> FloatArray:
        """The tractions (d, k) that reactions are."""

    @abstractmethod
    def pull(self, stiffness: float) -> FloatArray:
        """The reactions of springs that rest where the body would come to rest; collective."""

    def soft_springs(self, material: float) -> tuple[FloatArray, FloatArray]:
        soft = self.nodes.material_springs(material)
        return soft, soft

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.nodes.along(points, directions)

    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        return self.nodes.stiffer_than(factor * material, self.stiffest)

    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        self.nodes.add_traction(self.tractions(reactions), forces)

    @property
    def tool(self) -> int | None:
        return self.nodes.tool

    def add_tool_forces(
        self, reactions: FloatArray, forces: FloatArray, magnitudes: bool = False
    ) -> None:
        self.nodes.add_tool_forces(self.tractions(reactions), forces, magnitudes)
