"""Contact and friction as families of cones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.parallel import maximum, minimum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.cones import HalfLines
from contact_locking.solver.interior_point.contact_nodes import ContactNodes, OnContact
from contact_locking.solver.interior_point.lorentz import aligned, norm
from contact_locking.solver.interior_point.slips import Slips, along_planes
from contact_locking.solver.multipliers import Multipliers


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
        return self.nodes.normal_displacements(displacement)

    def tractions(self, reactions: FloatArray) -> FloatArray:
        return np.asarray(self.nodes.normal * reactions)

    @property
    def limit(self) -> FloatArray:  # type: ignore[override]
        # Tools that move change the gap.
        return self.nodes.gap

    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        return self.nodes.along(points, directions * self.nodes.normal[:, points])

    # The iterate.

    def sizes(self, deformation: float) -> FloatArray:
        return np.full_like(self.z, deformation)

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        forces = multipliers.contacts[self.nodes.number]
        self.nodes.enter(self.z, forces.pressure)
        # On the central path opening times pressure is constant; the larger one, in comparable
        # units, is the one that does not vanish.
        self.nodes.enter(self.z > self.x * stiffness / self.scale, forces.touches)

    def read(self, multipliers: Multipliers) -> FloatArray:
        return self.nodes.of_all(multipliers.contacts[self.nodes.number].pressure)

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        normal = self.nodes.normal
        self.tangent_block = stiffness[0] * normal[:, None] * normal

    # The start, and whether anything is admissible.

    def pull(self, stiffness: float) -> FloatArray:
        """Springs rest on the foundation inside the body, and on the nearest of it outside."""
        gap = self.nodes.gap
        nearest = max(minimum(self.comm, gap), 0.0)
        return -stiffness * np.minimum(gap, nearest)

    def is_kept(self, margin: float, displacement: float) -> bool:
        gap = self.nodes.gap
        size = margin * np.abs(self.seen) + ROUNDING * displacement + ROUNDING * np.abs(gap)
        return bool(np.all(self.seen - gap <= size))


class FrictionCones(OnContact, Slips):
    """``|sigma_tau| <= G`` against the slip of the step, ``u_tau - u_{k-1,tau}``, node by node.

    ``length`` is the extent of the body.
    """

    def __init__(self, nodes: ContactNodes, regularisation: float, length: float) -> None:
        self.nodes, self.normal = nodes, nodes.normal
        self.regularisation, self.scale = regularisation, length
        self.comm, self.weights = nodes.comm, nodes.weights
        rows = 1 + nodes.dim + (regularisation > 0.0)
        self.x, self.z = np.zeros((2, rows, len(nodes.weights)))
        self.bound_step, self.growth = np.zeros((2, len(nodes.weights)))

    def see(self, displacement: FloatArray) -> FloatArray:
        return self.nodes.slips(displacement)

    def look(self, displacement: FloatArray) -> None:
        self.seen = self.nodes.increments(displacement)

    def tractions(self, reactions: FloatArray) -> FloatArray:
        return reactions

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        self.nodes.enter(self.reactions, multipliers.contacts[self.nodes.number].friction)

    def read(self, multipliers: Multipliers) -> FloatArray:
        friction = multipliers.contacts[self.nodes.number].friction
        z = np.zeros_like(self.z)
        z[self._rows] = -self.nodes.of_all(friction).T
        z[0] = norm(z[self._rows])
        return z

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        # Data that turn the normal of a foundation turn slips and tractions with it.
        x, z = self.tangential(x), self.tangential(z)
        slips, bounds = (values[0] / (maximum(self.comm, values[0]) or 1.0) for values in (x, z))
        return aligned(x, z, slips >= bounds)

    def pull(self, stiffness: float) -> FloatArray:
        """Springs rest where the nodes stood before the step."""
        return -stiffness * self.nodes.old_slips()

    def write_block(self) -> None:
        self._write(self.a, self.b, self.w)

    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        first, rest = stiffness[0], stiffness[-1]
        self._write(rest, first - rest, self.springs[0][0])

    def _write(self, a: FloatArray, b: FloatArray, w: FloatArray) -> None:
        normal, w = self.normal, along_planes(w, self.normal)
        across = np.eye(len(normal))[:, :, None] - normal[:, None] * normal
        self.tangent_block = a * across + b * w[:, None] * w
