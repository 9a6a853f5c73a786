"""The interface of a family of cones.

Every family pairs a primal point with a multiplier at each of its points in space and eliminates
both from the Newton system, so that only the displacement is left.  With ``lin`` the part of the
displacement that the family sees (the strain at a point of a cell, u_nu or u_tau of a node), the
step of its reactions is ``c + D lin(du)``: ``D`` goes into the tangent, ``c`` into the right-hand
side.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.solver.multipliers import Multipliers

# Directions with a stiffness along each of them.
Springs: TypeAlias = list[tuple[FloatArray, FloatArray]]


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """``a . b`` of each column, (k,)."""
    return np.einsum("ik,ik->k", a, b)


@dataclass(frozen=True)
class Step:
    """The step of the primal points of a family and of their multipliers."""

    primal: FloatArray
    dual: FloatArray

    def plus(self, other: Step, share: float) -> Step:
        """The step plus ``share`` times the other."""
        return Step(self.primal + share * other.primal, self.dual + share * other.dual)


class Family(ABC):
    """Cones of one kind at k points with weights: everything that the method needs of them.

    ``x`` and ``z`` are the primal points and their multipliers, ``seen`` is what the family sees of
    the displacement that :meth:`look` was given last.  ``scale`` is 1 where products are per
    volume, and the length of the body where they are per area: means and targets are per volume.
    Arrays of vectors have one column for each point, so (m, k).
    """

    comm: MPI.Intracomm
    weights: FloatArray
    scale: float
    x: FloatArray
    z: FloatArray
    seen: FloatArray
    #: Whether the iterate has points in these cones; where it has none, the family keeps the
    #: springs that :meth:`hold` has put into the tangent.
    takes_part: bool = True
    #: The least compliance of a step, 0 for the step of the cones as they are.  The laws of the
    #: iterate do not have it: it acts on the change of multipliers, which vanishes in the end.
    softness: float = 0.0

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

    @property
    def reactions(self) -> FloatArray:
        """The reactions on the body: the locking stress, the pressure, or ``-sigma_tau``."""
        return self.reactions_of(self.z)

    @abstractmethod
    def reactions_of(self, z: FloatArray) -> FloatArray:
        """The reactions of multipliers, in which they are linear."""

    def look(self, displacement: FloatArray) -> None:
        """Everything from now on is about this displacement; collective.

        The gaps contain the present travels of the tools, so that the travels here are zero.
        """
        self.seen = self.see(displacement)

    # The iterate.

    @abstractmethod
    def start(self, level: float, least: float) -> None:
        """Points inside the cones near what was seen, on the central path or near it.

        ``level`` is the complementarity product per volume, ``least`` the least opening of contact.
        """

    def total(self, t: float = 0.0, step: Step | None = None) -> float:
        """The complementarity products after a step of length t, weighted, of this rank."""
        x, z = self.x, self.z
        if step is not None:
            x, z = x + t * step.primal, z + t * step.dual
        return self.power(x, z)

    @abstractmethod
    def speeds(self, step: Step) -> FloatArray:
        """The reciprocal (k,) of the longest step in each cone, 0 without a limit."""

    def longest_step(self, step: Step) -> float:
        """The largest t that leads out of no cone of this rank, inf without a limit."""
        speed = np.max(self.speeds(step), initial=0.0)
        # NaN is no direction to go in.
        return np.inf if speed <= 0.0 else 1.0 / speed if speed > 0.0 else 0.0

    def advance(self, t: float, step: Step) -> None:
        """Take a step of length t."""
        self.x += t * step.primal
        self.z += t * step.dual

    def primal_residual(self, deformation: float) -> float:
        """How far points are from what was seen, lengths over ``deformation``; collective."""
        return 0.0

    def relative_gap(self, size: FloatArray) -> float:
        """``|primal_gap|/|size|`` in the weighted L2 norm, 0 without a size; collective."""
        gap = self.primal_gap()
        local = np.array([self.power(gap, gap), self.power(size, size)])
        left, most = self.comm.allreduce(local)
        return float(np.sqrt(left / most)) if most > 0.0 else 0.0

    @abstractmethod
    def write(self, multipliers: Multipliers, stiffness: float) -> None:
        """Add the reactions; ``stiffness`` compares pressures with openings.  Collective."""

    # The Newton step.

    @abstractmethod
    def linearise(self) -> None:
        """Make the block D of the present points and of what was seen."""

    @abstractmethod
    def hold(self, stiffness: float | FloatArray) -> None:
        """Put springs ``D = stiffness``, a number or (k,), in place of the cones' block."""

    @abstractmethod
    def block(self, seen: FloatArray) -> FloatArray:
        """``D lin(du)`` with the present block D."""

    @abstractmethod
    def aim(self, target: float, correction: FloatArray | None = None) -> FloatArray:
        """The reactions that the step leads to if the displacement stands still.

        The complementarity products are driven to ``target``; ``correction`` is Mehrotra's
        second-order term of the predictor, with that of recentrings.
        """

    @abstractmethod
    def step(self, seen: FloatArray) -> Step:
        """The step that belongs to ``lin(du)``, towards the target that was aimed at."""

    @abstractmethod
    def correction(self, step: Step) -> FloatArray:
        """The second-order term of a step."""

    @abstractmethod
    def recentring(self, t: float, step: Step, band: tuple[float, float]) -> FloatArray:
        """The correction that brings the products after a step t back into a band, roughly."""

    # The derivative by the data.

    def centred(self, x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points and multipliers on the central path, near the given ones; collective.

        Off the path the scaling of Lorentz cones is no derivative of the iterate.
        """
        return x, z

    @abstractmethod
    def primal_gap(self) -> FloatArray:
        """How far the points are from the laws of the present data, in the shape of x."""

    @abstractmethod
    def move(self, gap: FloatArray) -> None:
        """Let steps be the change with data that move the points by ``gap``, in the shape of x.

        The complementarity products stay: ``dz = -W^-2 dx``.
        """

    @abstractmethod
    def move_adjoint(self, seen: FloatArray, reactions: FloatArray) -> FloatArray:
        """The adjoint of the map from a gap to the reactions that change if nothing moves.

        ``reactions`` are ``D seen``, with digits that ``seen`` has not.
        """

    @abstractmethod
    def settle(self, product: float) -> None:
        """Points of a ``product`` on the central path of the laws, which have a compliance."""

    # The tangent.

    @abstractmethod
    def write_block(self) -> None:
        """Put the block D into the tangent; collective."""

    def soften(self, factor: float, material: float) -> None:
        """Write the block without what the filter takes out of a body; collective."""
        self.write_block()

    @abstractmethod
    def stiff_nodes(self, factor: float, material: float) -> IndexArray:
        """The owned nodes of what is stiffer than the material by a factor; collective."""

    @property
    @abstractmethod
    def springs(self) -> Springs:
        """Directions d, (m, k), with the stiffness c (k,) of ``c d d^T`` in the block D."""

    def soft_springs(self, material: float) -> tuple[FloatArray | float, FloatArray | float]:
        """The stiffness of the material at the points, and what is left of a stiffer one."""
        return material, 0.0

    @abstractmethod
    def write_springs(self, stiffness: Sequence[FloatArray]) -> None:
        """Write the block with other stiffnesses of :meth:`springs`; collective."""

    @abstractmethod
    def along(self, points: IndexArray, directions: FloatArray) -> PETSc.Mat:
        """The matrix of ``v -> directions . lin(v)``, (m, p), at points (p,); collective."""

    def stiff_rows(self, factor: float, material: float) -> tuple[PETSc.Mat, FloatArray]:
        """``C`` (k, n) and ``B`` (k,): this family adds ``C^T B C`` where it is stiff; collective.

        ``C`` has a row for each point and each of the :meth:`springs` along which it is stiffer
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

    # The start, and whether anything is admissible.

    def is_kept(self, margin: float, displacement: float) -> bool:
        """Whether what was seen keeps its limits, but for a share ``margin``, on this rank.

        ``displacement`` is the largest in the body, which rounding is judged by.
        """
        return True

    def largest_multiplier(self) -> float:
        """The largest multiplier of a limit on the displacement, on this rank."""
        return 0.0

    def power(self, reactions: FloatArray, seen: FloatArray) -> float:
        """``int reactions . lin(u)`` of given reactions and ``lin(u)``, on this rank."""
        return float(self.weights @ dot(np.atleast_2d(reactions), np.atleast_2d(seen)))

    def resistance(self, reactions: FloatArray) -> float:
        """The most that :meth:`power` can be where the displacement is admissible, on this rank.

        Infinite for reactions that the limit has not; zero for cones that do not limit it.
        """
        return 0.0

    def holding(self, stiffness: float, largest: float) -> float | FloatArray:
        """Springs of this stiffness at most, whose forces may change the present reactions.

        ``largest`` is the largest multiplier of all families.
        """
        return stiffness


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
    """A step of the displacement with the travels, and of every family that takes part."""

    displacement: FloatArray
    steps: Mapping[Family, Step]

    def plus(self, other: Direction, share: float) -> Direction:
        """The direction plus ``share`` times the other."""
        return Direction(
            self.displacement + share * other.displacement,
            {family: step.plus(other.steps[family], share) for family, step in self.steps.items()},
        )

    def between(self, other: Direction, share: float) -> Direction:
        """The direction plus ``share`` times what leads from it to the other."""
        return other if share == 1.0 else self.plus(other.plus(self, -1.0), share)
