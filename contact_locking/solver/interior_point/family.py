"""Families of cones: cones with the part of the displacement that they see."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.solver.interior_point.cones import Composite, PointCones, Step
from contact_locking.solver.interior_point.lorentz import dot
from contact_locking.solver.task import Multipliers


class Family(PointCones):
    """Cones at points of the body, with the operator ``lin`` of what they see, and its adjoint.

    What a cone tells is about the points of this rank.
    """

    comm: MPI.Intracomm
    #: Whether the iterate has points in these cones; where it has none, the family keeps the
    #: springs that :meth:`hold` has put into the tangent.
    takes_part: bool = True

    # The displacement and the forces.

    @abstractmethod
    def see(self, displacement: FloatArray) -> FloatArray:
        """``lin`` of a displacement: (m, k), or (k,) of a scalar; collective.

        Displacements are the owned values, and behind them the travels of the tools.
        """

    @abstractmethod
    def add_forces(self, reactions: FloatArray, forces: PETSc.Vec) -> None:
        """``forces += int reactions . lin(.)``, the adjoint of :meth:`see`; collective."""

    @property
    def tool(self) -> int | None:
        """The number of the free foundation that the family sees, None without one."""
        return None

    def add_tool_forces(
        self, reactions: FloatArray, forces: FloatArray, magnitudes: bool = False
    ) -> None:
        """The same for the travels of the tools (T,), or its magnitudes, of this rank."""
        return

    def look(self, displacement: FloatArray) -> None:
        """Everything from now on is about this displacement; collective.

        The gaps contain the present travels of the tools, so that the travels here are zero.
        """
        self.seen = self.see(displacement)

    @abstractmethod
    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        """Add the reactions; ``stiffness`` compares pressures with openings.  Collective."""

    @abstractmethod
    def read(self, multipliers: Multipliers) -> FloatArray:
        """The z whose reactions :meth:`write` has written."""

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points and multipliers on the central path, near the given ones; collective.

        Off the path the scaling of Lorentz cones is no derivative of the iterate.
        """
        return x, z

    def primal_residual(self, deformation: float) -> float:
        """``|primal_gap|/|sizes|`` in the weighted L2 norm, 0 without sizes; collective."""
        sizes = self.sizes(deformation)
        if sizes is None:
            return 0.0
        gap = self.primal_gap()
        local = np.array([self.power(gap, gap), self.power(sizes, sizes)])
        left, most = self.comm.allreduce(local)
        return float(np.sqrt(left / most)) if most > 0.0 else 0.0

    def is_kept(self, margin: float, displacement: float) -> bool:
        """Whether what was seen keeps its limits, but for a share ``margin``, on this rank.

        ``displacement`` is the largest in the body, which rounding is judged by.
        """
        return True

    # The tangent.

    @abstractmethod
    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        """Put the block D into the tangent, with other stiffnesses of ``springs``; collective."""

    def write_block(self) -> None:
        """Put the block D into the tangent; collective."""
        self.write_springs([values for _, values in self.springs])

    def soften(self, factor: float, material: float) -> None:
        """Write the block without what the filter takes out of a body; collective."""
        self.write_block()

    @abstractmethod
    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        """The owned nodes of what is stiffer than the material by a factor; collective."""

    def soft_springs(self, material: float) -> tuple[FloatArray | float, FloatArray | float]:
        """The stiffness of the material at the points, and what is left of a stiffer one."""
        return material, 0.0

    @abstractmethod
    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``v -> directions . lin(v)``, (m, p), at points (p,); collective."""

    def stiff_rows(self, factor: float, material: float) -> tuple[PETSc.Mat, FloatArray]:
        """``C`` (k, n) and ``B`` (k,): this family adds ``C^T B C`` where it is stiff; collective.

        ``C`` has a row for each point and each of the ``springs`` along which it is stiffer
        than the material by the factor.
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

    def soften_along(self, factor: float, material: float) -> None:
        """Write the block without the stiffness of :meth:`stiff_rows`; collective."""
        soft, kept = self.soft_springs(material)
        self.write_springs(
            [
                np.where(values * dot(direction, direction) > factor * soft, kept, values)
                for direction, values in self.springs
            ]
        )


@dataclass(frozen=True)
class Reaction:
    """Reactions of a family that act on the body."""

    family: Family
    values: FloatArray

    @classmethod
    def of(cls, families: Iterable[Family]) -> list[Reaction]:
        return [cls(family, family.reactions) for family in families]

    def add_to(self, forces: PETSc.Vec) -> None:
        """Add the forces; collective."""
        self.family.add_forces(self.values, forces)


@dataclass(frozen=True)
class Direction:
    """A step of the displacement with the travels, and of the cones that take part."""

    displacement: FloatArray
    step: Step
    cones: Composite

    def of(self, family: Family) -> Step:
        """The step of one family."""
        return self.cones.steps(self.step)[self.cones.cones.index(family)]

    def plus(self, other: Direction, share: float) -> Direction:
        """The direction plus ``share`` times the other."""
        moved = self.displacement + share * other.displacement
        return Direction(moved, self.step.plus(other.step, share), self.cones)
