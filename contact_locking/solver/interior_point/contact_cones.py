"""The cones of contact: half lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import minimum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.contact_nodes import ContactNodes, OnContact
from contact_locking.solver.interior_point.family import Springs
from contact_locking.solver.interior_point.half_lines import HalfLines
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
    def limit(self) -> FloatArray:
        return self.nodes.gap

    # The iterate.

    def start(self, level: float, least: float) -> None:
        self.x = np.maximum(self.nodes.gap - self.seen, least)
        self.z = np.asarray(level * self.scale / self.x)

    def primal_residual(self, deformation: float) -> float:
        return self.relative_gap(np.full_like(self.z, deformation))

    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        forces = multipliers.contacts[self.nodes.number]
        self.nodes.enter(self.z, forces.pressure)
        # On the central path opening times pressure is constant; the larger one, in comparable
        # units, is the one that does not vanish.
        self.nodes.enter(self.z > self.x * stiffness / self.scale, forces.touches)

    # The tangent.

    def write_block(self) -> None:
        self.write_springs([self.stiffness])

    @property
    def stiffest(self) -> FloatArray:
        return self.stiffness

    @property
    def springs(self) -> Springs:
        return [(self.nodes.normal, self.stiffness)]

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
