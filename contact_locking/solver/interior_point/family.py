"""Families of cones: all cones of one law and contact, with their operator on displacements."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.solver.interior_point.cones import Composite, PointCones, Step
from contact_locking.solver.interior_point.lorentz import dot
from contact_locking.solver.task import Multipliers


class Family(PointCones):
    """Cones at points of the body, with the linear operator ``lin`` and its adjoint.

    Values are those of the points of this rank; the methods with ``displacement``, ``forces`` or
    matrices are collective.
    """

    comm: MPI.Intracomm
    #: Whether the iterate has points in these cones.  If not, the springs of :meth:`hold` stay in
    #: the tangent.
    takes_part: bool = True

    # The displacement and the forces.

    @abstractmethod
    def see(self, displacement: FloatArray) -> FloatArray:
        """``lin`` of a displacement: (m, k), or (k,) for a scalar.

        Displacements are the owned values, followed by the travels of the tools.
        """

    @abstractmethod
    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int reactions . lin(.)``, the adjoint of :meth:`see`."""

    @property
    def tool(self) -> int | None:
        """The number of the pushed foundation of this contact, None without one."""
        return None

    def add_tool_forces(
        self, reactions: FloatArray, forces: FloatArray, magnitudes: bool = False
    ) -> None:
        """Add the forces on the travels of the tools (T,), or their magnitudes, of this rank."""
        return

    def update(self, displacement: FloatArray) -> None:
        """Set ``seen`` for this displacement.

        Its travels are zero, because the gaps contain the present travels of the tools.
        """
        self.seen = self.see(displacement)

    @abstractmethod
    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        """Write the reactions into multipliers; ``stiffness`` compares pressures with openings."""

    @abstractmethod
    def read(self, multipliers: Multipliers) -> FloatArray:
        """The z of multipliers, the inverse of :meth:`write`."""

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """A pair on the central path, near (x, z); collective.

        Only there the scaling of Lorentz cones is the derivative of the iterate.
        """
        return x, z

    def primal_residual(self, deformation: float) -> float:
        """``|primal_gap|/|sizes|`` in the weighted L2 norm, 0 without sizes; collective."""
        sizes = self.sizes(deformation)
        if sizes is None:
            return 0.0
        gap = self.primal_gap()
        local = np.array([self.power(gap, gap), self.power(sizes, sizes)])
        square, size = self.comm.allreduce(local)
        return float(np.sqrt(square / size)) if size > 0.0 else 0.0

    def is_kept(self, margin: float, displacement: float) -> bool:
        """Whether the displacement exceeds no limit on this rank by more than a share ``margin``.

        ``displacement`` is the largest in the body, the scale of rounding.
        """
        return True

    # The tangent.

    @abstractmethod
    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        """Write the block D for the tangent, with other stiffnesses of ``springs``."""

    def write_block(self) -> None:
        """Write the block D for the tangent."""
        self.write_springs([values for _, values in self.springs])

    @abstractmethod
    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        """The owned nodes where the block is stiffer than the material by a factor."""

    def soft_springs(self, material: float) -> tuple[FloatArray | float, FloatArray | float]:
        """The stiffness of the material at the points, and the one that replaces a larger one."""
        return material, 0.0

    @abstractmethod
    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``v -> directions . lin(v)`` for directions (m, p) at points (p,)."""

    def stiff_rows(self, factor: float, material: float) -> tuple[PETSc.Mat, FloatArray]:
        """``C`` (r, n) and ``B`` (r,): the stiff part of this family is ``C^T B C``.

        ``C`` has a row for each spring at a point that is stiffer than the material by the factor.
        """
        soft, kept = self.soft_springs(material)
        points, directions, stiffness = [], [], []
        for direction, values in self.springs:
            stiff = np.flatnonzero(values * dot(direction, direction) > factor * soft)
            points.append(stiff.astype(np.int32))
            directions.append(direction[:, stiff])
            stiffness.append((self.weights * (values - kept))[stiff])
        rows = self.along(np.concatenate(points), np.hstack(directions))
        return rows, np.concatenate(stiffness)

    def soften(self, factor: float, material: float) -> None:
        """Write the block without what :meth:`stiff_rows` takes, for multigrid."""
        soft, kept = self.soft_springs(material)
        self.write_springs(
            [
                np.where(values * dot(direction, direction) > factor * soft, kept, values)
                for direction, values in self.springs
            ]
        )


#: The reactions of families on the body, in the shapes of what they see.
Reactions: TypeAlias = Mapping[Family, FloatArray]


@dataclass(frozen=True)
class Direction:
    """A step of the displacement, with the travels, and of the active cones."""

    displacement: FloatArray
    step: Step
    cones: Composite[Family]

    def of(self, family: Family) -> Step:
        """The step of one family."""
        return self.cones.steps(self.step)[family]

    def plus(self, other: Direction, share: float) -> Direction:
        """The direction plus ``share`` times the other."""
        moved = self.displacement + share * other.displacement
        return Direction(moved, self.step.plus(other.step, share), self.cones)
