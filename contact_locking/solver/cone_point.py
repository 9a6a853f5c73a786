"""The iterate of the interior point method: a displacement, and a point in every cone."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from contact_locking.solver.blocks import ContactBlock, FrictionBlock, LockingBlock
from contact_locking.solver.cone_system import ConeSystem
from contact_locking.solver.measures import relative_rms
from contact_locking.solver.multipliers import Multipliers

FloatArray = npt.NDArray[np.float64]

# A step of the displacement (owned values), and the primal and dual step of each block.
Direction: TypeAlias = tuple[FloatArray, list[Any]]


class ConePoint:
    """The blocks of locking, contact and friction over one :class:`ConeSystem`, taken together.

    Products on Gamma_C are per area; means and targets are per volume, so ``length`` goes between.
    """

    def __init__(
        self,
        cones: ConeSystem,
        length: float,
        locking: LockingBlock,
        contact: ContactBlock | None = None,
        friction: FrictionBlock | None = None,
    ) -> None:
        self.cones, self._length = cones, length
        self.locking, self.contact, self.friction = locking, contact, friction
        every = (locking, contact, friction)
        self._blocks: list[Any] = [block for block in every if block is not None]
        self._scales = [1.0, length, length][: len(self._blocks)]
        measures = zip(self._scales, self._blocks, strict=True)
        local = sum(scale * float(block.weights.sum()) for scale, block in measures)
        self._measure = float(cones.comm.allreduce(local)) or 1.0

    def visit(self) -> None:
        """Look at the system's displacement: everything below is about it; collective."""
        cones = self.cones
        displacement = cones.system.u.x.array
        cones.visit()
        self.strain = cones.strains(displacement)
        if self.contact is not None:
            self._opening = cones.node_gap - cones.normal_displacements(displacement)
        if self.friction is not None:
            self._slip = cones.slips(displacement)

    def linearise(self) -> None:
        """Assemble the tangent of the point visited last; collective."""
        locking = self.locking.linearise(self.strain)
        contact = None if self.contact is None else self.contact.linearise(self._opening)
        friction = None if self.friction is None else self.friction.linearise(self._slip)
        self.cones.set_scaling(locking, contact, friction)

    def direction(self, target: float, corrections: list[Any] | None, accuracy: float) -> Direction:
        """The steps of displacement and blocks towards products of ``target``; collective."""
        cones = self.cones
        given = corrections or [None] * len(self._blocks)
        aims: list[Any] = [None, None, None]
        for i, (block, scale) in enumerate(zip(self._blocks, self._scales, strict=True)):
            aims[i] = block.aim(target * scale, given[i])
        du = cones.solve_step(aims[0], aims[1], aims[2], accuracy)
        steps: list[Any] = [self.locking.step(cones.strains(du))]
        if self.contact is not None:
            steps.append(self.contact.step(cones.normal_displacements(du)))
        if self.friction is not None:
            steps.append(self.friction.step(cones.slips(du)))
        return du, steps

    def response(self, bound_step: FloatArray, accuracy: float) -> tuple[FloatArray, FloatArray]:
        """The steps of pressure (k,) and slip (d, k) by a step of the bound; collective."""
        assert self.contact is not None and self.friction is not None
        cones = self.cones
        du = cones.respond(self.friction.response(bound_step), accuracy)
        return self.contact.response(cones.normal_displacements(du)), cones.slips(du)

    def corrections(self, direction: Direction, weight: float) -> list[Any]:
        """Mehrotra's second-order terms of a direction, times ``weight``."""
        return [
            weight * block.correction(*step)
            for block, step in zip(self._blocks, direction[1], strict=True)
        ]

    def recentred(
        self, corrections: list[Any], reach: float, direction: Direction, target: float
    ) -> list[Any]:
        """The corrections that lead products after a step of ``reach`` nearer to ``target``."""
        return [
            correction - block.recentring(reach, *step, target * scale)
            for correction, block, step, scale in zip(
                corrections, self._blocks, direction[1], self._scales, strict=True
            )
        ]

    def longest_step(self, direction: Direction) -> float:
        """How far a direction leads before a cone ends; collective."""
        pairs = zip(self._blocks, direction[1], strict=True)
        local = min(block.longest_step(*step) for block, step in pairs)
        return float(self.cones.comm.allreduce(local, op=MPI.MIN))

    def advance(self, t: float, direction: Direction) -> None:
        """Take a step of length t; collective."""
        self.cones.move(t, direction[0])
        for block, step in zip(self._blocks, direction[1], strict=True):
            block.advance(t, *step)

    def total_product(self) -> float:
        """The duality gap: all complementarity products, integrated; collective."""
        return float(self.cones.comm.allreduce(sum(block.total() for block in self._blocks)))

    def mean_product(self) -> float:
        """The mean over all cones; collective."""
        return self.total_product() / self._measure

    def mean_product_after(self, t: float, direction: Direction) -> float:
        """The mean after a step of length t; collective."""
        pairs = zip(self._blocks, direction[1], strict=True)
        local = sum(block.total(t, step) for block, step in pairs)
        return float(self.cones.comm.allreduce(local)) / self._measure

    def locking_work(self) -> float:
        """``|int Z : eps(u)|`` at the displacement visited last; collective."""
        work = np.sum(self.locking.stress * self.strain, axis=0)
        return abs(float(self.cones.comm.allreduce(float(self.cones.volumes @ work))))

    def primal_residual(self, deformation: float) -> float:
        """How far strains and openings are from the points of their cones, relative; collective.

        ``deformation`` is the length that openings are judged against.
        """
        cones, locking, contact = self.cones, self.locking, self.contact
        residual = locking.primal_residual(self.strain)
        result = relative_rms(cones.comm, cones.volumes, residual, locking.x)
        if contact is None:
            return result
        residual = contact.primal_residual(self._opening)
        size = np.full_like(residual, deformation)
        return max(result, relative_rms(cones.comm, contact.weights, residual, size))

    def equilibrium_residual(self) -> float:
        """The norm of the forces that displacement and multipliers leave unbalanced; collective."""
        pressure = None if self.contact is None else self.contact.z
        traction = None if self.friction is None else self.friction.traction
        return self.cones.residual_norm(self.locking.stress, pressure, traction)

    def largest_multiplier(self) -> float:
        """The largest locking multiplier or pressure; collective."""
        local = float(self.locking.z[0].max(initial=0.0))
        if self.contact is not None:
            local = max(local, float(self.contact.z.max(initial=0.0)))
        return float(self.cones.comm.allreduce(local, op=MPI.MAX))

    def multipliers(self, stiffness: float) -> Multipliers:
        """As functions and nodal values; ``stiffness`` compares pressures with openings."""
        stress, contact, friction = self.locking.stress, self.contact, self.friction
        if contact is None:
            return self.cones.multipliers(stress, None, None, None)
        # On the central path opening times pressure is constant; the larger one, in comparable
        # units, is the one that does not vanish.
        touches = contact.z > contact.x * stiffness / self._length
        traction = None if friction is None else friction.traction
        return self.cones.multipliers(stress, contact.z, traction, touches)
