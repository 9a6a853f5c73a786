"""Contact and friction as families of cones at the nodes of one part of Gamma_C."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.fem.contact_operator import PointStiffness
from contact_locking.parallel import maximum, minimum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.lorentz import aligned, dot, norm
from contact_locking.solver.interior_point.slips import Slips, along_planes
from contact_locking.solver.task import Multipliers

Scalar = TypeVar("Scalar", bound=np.generic)


class ContactNodes:
    """The k owned nodes of a contact whose normal displacement is not prescribed.

    - ``contact``, ``number``: the contact, and its index among all contacts
    - ``normal``, ``weights``: (d, k) and (k,); all vectors are (d, k), scalars (k,)
    - ``tool``, ``direction``: the index and direction (d,) of a pushed foundation; None and zero
    """

    def __init__(self, contact: NodalContact, number: int, system: System) -> None:
        self.contact, self.number = contact, number
        self.comm, self.dim = system.comm, system.dim
        surface, self._active = contact.surface, contact.free
        self.normal = np.ascontiguousarray(contact.normals[self._active].T)
        self.operator = surface.operator
        self.points = np.flatnonzero(self._active).astype(np.int32)
        self.weights = surface.weights[self._active]
        contacts = [tool.contact for tool in system.tools]
        self.tool = contacts.index(contact) if contact in contacts else None
        none = np.zeros(self.dim)
        self.direction = none if self.tool is None else system.tools[self.tool].direction
        self._owned = len(system.load)

    @property
    def gap(self) -> FloatArray:
        """The gap (k,)."""
        return self.contact.gaps[self._active]

    def old_slips(self) -> FloatArray:
        """``u_{k-1,tau}`` (d, k), before the step."""
        return self.contact.references[self._active].T

    def stiffness(self, block: FloatArray) -> PointStiffness:
        """The stiffness of blocks D (d, d, k)."""
        return PointStiffness(self.operator, self.at_all(self.weights * block))

    def material_springs(self, material: float) -> FloatArray:
        """The stiffness per area (k,) that corresponds to a material of this stiffness."""
        return np.asarray(material * self.weights ** (-1.0 / (self.dim - 1)))

    def along(self, places: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``v -> directions . v``, (d, p), at nodes ``places`` (p,); collective."""
        return self.operator.along(self.points[places], directions.T)

    def at_all(self, values: FloatArray) -> FloatArray:
        """Values (..., k) extended by zero to all owned nodes of the contact, (K, ...)."""
        result = np.zeros((len(self._active), *values.shape[:-1]))
        result[self._active] = np.moveaxis(values, -1, 0)
        return result

    def of_all(self, values: FloatArray) -> FloatArray:
        """The values (k, ...) at these nodes of values at all owned nodes of the contact."""
        return np.asarray(values[self._active])

    def scatter(self, values: npt.NDArray[Scalar], into: npt.NDArray[Scalar]) -> None:
        """Write values (k,) or (d, k) into an array over all owned nodes of the contact."""
        into[self._active] = values.T

    def displacements(self, displacement: FloatArray) -> FloatArray:
        """The displacements (d, k) of the nodes, relative to tools; collective."""
        values = self.operator.values(displacement)[self._active].T
        if self.tool is None:
            return values
        return np.asarray(values - displacement[self._owned + self.tool] * self.direction[:, None])


class OnContact(Family):
    """A family of cones at the nodes of a contact."""

    nodes: ContactNodes
    #: The block (d, d, k) of the tangent, for displacements of the nodes.
    tangent_block: FloatArray

    @abstractmethod
    def tractions(self, reactions: FloatArray) -> FloatArray:
        """The tractions (d, k) of reactions."""

    @abstractmethod
    def pull(self, stiffness: float) -> FloatArray:
        """The reactions at u = 0 of springs that stand for the contact at the start; collective."""

    def soft_springs(self, material: float) -> tuple[FloatArray, FloatArray]:
        soft = self.nodes.material_springs(material)
        return soft, soft

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.nodes.along(points, directions)

    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        is_stiff = self.stiffest > self.nodes.material_springs(factor * material)
        return self.nodes.operator.blocks_of(self.nodes.points[is_stiff])

    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        traction = self.weights * self.tractions(reactions)
        self.nodes.operator.add_forces(self.nodes.at_all(traction), forces)

    @property
    def tool(self) -> int | None:
        return self.nodes.tool

    def add_tool_forces(
        self, reactions: FloatArray, forces: FloatArray, magnitudes: bool = False
    ) -> None:
        if self.tool is not None:
            along = self.nodes.direction @ self.tractions(reactions)
            forces[self.tool] += (np.abs(along) if magnitudes else -along) @ self.weights


class ContactCones(OnContact, HalfLines):
    """``c = gap + eps p - u_nu >= 0``, ``p >= 0``, ``c p = 0``, node by node: ``x = c``, ``z = p``.

    ``compliance`` is the penalty parameter eps, 0 for the inequality itself, ``length`` the extent
    of the body.
    """

    def __init__(self, nodes: ContactNodes, compliance: float, length: float) -> None:
        self.nodes, self.compliance, self.scale = nodes, compliance, length
        self.comm, self.weights = nodes.comm, nodes.weights
        self.x, self.z = np.zeros((2, len(nodes.weights)))

    # The displacement and the forces.

    def see(self, displacement: FloatArray) -> FloatArray:
        return dot(self.nodes.displacements(displacement), self.nodes.normal)

    def tractions(self, reactions: FloatArray) -> FloatArray:
        return np.asarray(self.nodes.normal * reactions)

    @property
    def limit(self) -> FloatArray:  # type: ignore[override]
        # The gap changes with the travels of tools.
        return self.nodes.gap

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.nodes.along(points, directions * self.nodes.normal[:, points])

    # The iterate.

    def sizes(self, deformation: float) -> FloatArray:
        return np.full_like(self.z, deformation)

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        forces = multipliers.contacts[self.nodes.number]
        self.nodes.scatter(self.z, forces.pressure)
        # On the central path opening times pressure is constant, and the larger of the two, in
        # comparable units, is the one that is not zero in the limit.
        self.nodes.scatter(self.z > self.x * stiffness / self.scale, forces.touches)

    def read(self, multipliers: Multipliers) -> FloatArray:
        return self.nodes.of_all(multipliers.contacts[self.nodes.number].pressure)

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        normal = self.nodes.normal
        self.tangent_block = stiffness[0] * normal[:, None] * normal

    # The start, and whether anything is admissible.

    def pull(self, stiffness: float) -> FloatArray:
        """Springs push overlapping nodes out, and pull all others by the least gap, if positive."""
        gap = self.nodes.gap
        nearest = max(minimum(self.comm, gap), 0.0)
        return -stiffness * np.minimum(gap, nearest)

    def is_kept(self, margin: float, displacement: float) -> bool:
        gap = self.nodes.gap
        size = margin * np.abs(self.seen) + ROUNDING * displacement + ROUNDING * np.abs(gap)
        return bool(np.all(self.seen - gap <= size))


class FrictionCones(OnContact, Slips):
    """``|sigma_tau| <= G`` against the slip of the step, ``u_tau - u_{k-1,tau}``, node by node.

    ``length`` is the extent of the body, and ``regularisation`` the length eps of (22).
    """

    def __init__(self, nodes: ContactNodes, regularisation: float, length: float) -> None:
        self.nodes, self.normal = nodes, nodes.normal
        self.regularisation, self.scale = regularisation, length
        self.comm, self.weights = nodes.comm, nodes.weights
        rows = 1 + nodes.dim + (regularisation > 0.0)
        self.x, self.z = np.zeros((2, rows, len(nodes.weights)))
        self.bound_step, self.growth = np.zeros((2, len(nodes.weights)))

    def see(self, displacement: FloatArray) -> FloatArray:
        return along_planes(self.nodes.displacements(displacement), self.normal)

    def update(self, displacement: FloatArray) -> None:
        moved = self.nodes.displacements(displacement) - self.nodes.old_slips()
        self.seen = along_planes(moved, self.normal)

    def tractions(self, reactions: FloatArray) -> FloatArray:
        return reactions

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.nodes.scatter(self.reactions, multipliers.contacts[self.nodes.number].friction)

    def read(self, multipliers: Multipliers) -> FloatArray:
        friction = multipliers.contacts[self.nodes.number].friction
        z = np.zeros_like(self.z)
        z[self.rows] = -self.nodes.of_all(friction).T
        z[0] = norm(z[self.rows])
        return z

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        # If the data rotate the normals, slips and tractions must follow.
        x, z = self.tangential(x), self.tangential(z)
        slips, bounds = (values[0] / (maximum(self.comm, values[0]) or 1.0) for values in (x, z))
        return aligned(x, z, slips >= bounds)

    def pull(self, stiffness: float) -> FloatArray:
        """Springs pull the nodes towards their positions before the step."""
        return -stiffness * self.nodes.old_slips()

    def write_block(self) -> None:
        self._write(self.a, self.b, self.w)

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        along, across = stiffness[0], stiffness[-1]
        self._write(across, along - across, self.springs[0][0])

    def _write(self, a: FloatArray, b: FloatArray, w: FloatArray) -> None:
        normal, w = self.normal, along_planes(w, self.normal)
        across = np.eye(len(normal))[:, :, None] - normal[:, None] * normal
        self.tangent_block = a * across + b * w[:, None] * w
