"""The iterate of the interior point method: a displacement, and a point in every cone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import exceeded_by_few, maximum, minimum, on_every_rank
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.contact_cones import FrictionCones
from contact_locking.solver.interior_point.family import Direction, Family, Reaction
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.tangent import Tangent

# Mehrotra's second-order terms, with those of recentrings, of each family.
Corrections = Mapping[Family, FloatArray]
_NONE: Corrections = {}


def added(corrections: Corrections, changes: Corrections, share: float = 1.0) -> Corrections:
    """Corrections with a share of the changes added."""
    return {family: values + share * changes[family] for family, values in corrections.items()}


class Iterate:
    """The system's displacement, and the points of the families that take part, together.

    Products on Gamma_C are per area; means and targets are per volume, so that the scale of the
    family goes between.
    """

    def __init__(self, tangent: Tangent, band: tuple[float, float]) -> None:
        self.tangent, self.comm, self._band = tangent, tangent.comm, band
        self.families = [family for family in tangent.families if family.takes_part]
        local = sum(family.scale * float(family.weights.sum()) for family in self.families)
        self._measure = float(self.comm.allreduce(local)) or 1.0

    @property
    def is_finite(self) -> bool:
        """Whether no point and no multiplier has lost its digits; collective."""
        digits = [values for family in self.families for values in (family.x, family.z)]
        return on_every_rank(self.comm, all(bool(np.isfinite(part).all()) for part in digits))

    def visit(self) -> None:
        """Look at the system's displacement: everything below is about it; collective."""
        self.tangent.visit()
        for family in self.families:
            family.look(self.tangent.present())

    def soften(self, softness: float) -> None:
        """Let steps have the compliance ``softness`` at least, a strain over a stress."""
        for family in self.families:
            family.softness = softness * family.scale

    def linearise(self) -> None:
        """Assemble the tangent of the point visited last; collective."""
        for family in self.families:
            family.linearise()
        self.tangent.refresh()

    def direction(
        self, target: float, accuracy: float, corrections: Corrections = _NONE
    ) -> Direction:
        """The steps of displacement and families towards products of ``target``; collective."""
        aims = self.aims(target, corrections)
        return self._direction_of(self.tangent.solve_step(aims, accuracy))

    def direction_with(
        self, displacement: FloatArray, target: float, corrections: Corrections
    ) -> Direction:
        """The steps of the families with a known step of the displacement; collective."""
        self.aims(target, corrections)
        return self._direction_of(displacement)

    def balanced(self, direction: Direction, t: float, accuracy: float) -> Direction:
        """The direction changed so that a step of length t balances the forces; collective.

        Forces are linear in displacement and multipliers, and products change in second
        order only.
        """
        at_rest = self._direction_of(self.tangent.nothing())
        reactions = [
            Reaction(family, family.reactions_of(family.z + t * step.dual))
            for family, step in direction.steps.items()
        ]
        du = self.tangent.step_after(t * direction.displacement, reactions, accuracy)
        return direction.plus(self._direction_of(du).plus(at_rest, -1.0), 1.0 / t)

    def aims(self, target: float, corrections: Corrections) -> list[Reaction]:
        """The reactions that steps towards products of ``target`` lead to if nothing moves."""
        return [
            Reaction(family, family.aim(target, corrections.get(family)))
            for family in self.families
        ]

    def _direction_of(self, du: FloatArray) -> Direction:
        """The steps of the families with a step of the displacement, towards what they aim at."""
        return Direction(du, {family: family.step(family.see(du)) for family in self.families})

    def corrections(self, direction: Direction, weight: float) -> Corrections:
        """Mehrotra's second-order terms of a direction, times ``weight``."""
        steps = direction.steps
        return {family: weight * family.correction(steps[family]) for family in self.families}

    def recentring(self, reach: float, direction: Direction, target: float) -> Corrections:
        """The corrections that lead products after a step of ``reach`` nearer to ``target``."""
        band = self._band[0] * target, self._band[1] * target
        return {
            family: -family.recentring(reach, direction.steps[family], band)
            for family in self.families
        }

    def longest_step(self, direction: Direction) -> float:
        """How far a direction leads before a cone ends; collective."""
        local = min(family.longest_step(direction.steps[family]) for family in self.families)
        return minimum(self.comm, local)

    def longest_step_of_most(self, direction: Direction, share: float) -> float:
        """How far a direction leads, 1 at most, before a larger share of cones ends; collective."""
        speeds = np.concatenate([f.speeds(direction.steps[f]) for f in self.families])
        few = int(share * self.comm.allreduce(len(speeds)))
        return 1.0 / exceeded_by_few(self.comm, speeds, few, 1.0)

    def advance(self, t: float, direction: Direction) -> None:
        """Take a step of length t; collective."""
        self.tangent.move(t, direction.displacement)
        for family in self.families:
            family.advance(t, direction.steps[family])

    def total_product(self) -> float:
        """The duality gap: all complementarity products, integrated; collective."""
        return self._measure * self.mean_product()

    def least_product(self) -> float:
        """The duality gap of products that are told from rounding in all cones; collective."""
        rubbing = [family for family in self.families if isinstance(family, FrictionCones)]
        least = max((family.least_product() for family in rubbing), default=0.0)
        return self._measure * maximum(self.comm, least)

    def mean_product(self, t: float = 0.0, direction: Direction | None = None) -> float:
        """The mean over all cones after a step of length t; collective."""
        steps = {} if direction is None else direction.steps
        local = sum(family.total(t, steps.get(family)) for family in self.families)
        return float(self.comm.allreduce(local)) / self._measure

    @property
    def limits_of_strain(self) -> list[LimitsOfStrain]:
        return [family for family in self.families if isinstance(family, LimitsOfStrain)]

    def body_work(self) -> float:
        """``|int Z : eps(u)|`` at the displacement visited last; collective."""
        local = sum(item.power(item.reactions, item.seen) for item in self.limits_of_strain)
        return abs(float(self.comm.allreduce(local)))

    def primal_residual(self, deformation: float) -> float:
        """How far points are from their laws, relative, lengths to ``deformation``; collective."""
        return max(family.primal_residual(deformation) for family in self.families)

    def equilibrium_residual(self, scale: float, tolerance: float) -> float:
        """The unbalanced forces relative to ``scale``; collective.

        A force below the rounding in the reactions counts as within the tolerance: a strain
        beyond its limit makes these large beside loads and elastic forces.
        """
        reactions = Reaction.of(self.families)
        left, reaction = self.tangent.residual_norms(reactions)
        # Nothing is left where there are no forces at all.
        relative = left / max(scale, ROUNDING * reaction / tolerance) if left > 0.0 else 0.0
        return max(relative, self.tangent.tool_residual(reactions))

    def largest_multiplier(self) -> float:
        """The largest multiplier of a limit on the displacement; collective."""
        return maximum(self.comm, max(family.largest_multiplier() for family in self.families))

    def describe_excess(self) -> str:
        """Which limit the displacement visited last exceeds, and where; collective."""
        reasons = [family.describe_excess() for family in self.limits_of_strain]
        return next(filter(None, reasons), "the foundation is in the way")
