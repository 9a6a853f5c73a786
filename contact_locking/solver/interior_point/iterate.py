"""The families of cones of a system, and the iterate: a displacement, and a point in every cone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import (
    exceeded_by_few,
    maximum,
    minimum,
    on_any_rank,
    on_every_rank,
)
from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.strain_sets import HalfSpaceSet, NormSet, StrainSet
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.bound_step import MovingBound
from contact_locking.solver.interior_point.cones import Composite, joined
from contact_locking.solver.interior_point.contact_cones import (
    ContactCones,
    ContactNodes,
    FrictionCones,
)
from contact_locking.solver.interior_point.family import Direction, Family, Reaction
from contact_locking.solver.interior_point.locking_cones import (
    LimitsOfStrain,
    LockingCones,
    StrainHalfLines,
    StrainOperator,
)
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.task import Target

_CONES: dict[type[StrainSet], type[LockingCones | StrainHalfLines]] = {
    NormSet: LockingCones,
    HalfSpaceSet: StrainHalfLines,
}


@dataclass(frozen=True)
class Families:
    """All families of a system, and what ties friction to the pressure of its contact.

    A family of cones of another kind is one more entry of the list that :func:`families_of` makes.
    ``strains`` has the operator of each set of strains that limits a point.
    """

    every: list[Family]
    bounds: list[MovingBound]
    strains: list[StrainOperator]

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        for operator in self.strains:
            operator.destroy()


def families_of(
    system: System,
    target: Target,
    least_bound: float,
    share: float = 1.0,
) -> Families:
    """A family for each set of strains, and contact and friction for each part of Gamma_C.

    A set without a limit anywhere has no family: its forms take as long as some tangents.
    Without friction on a part there is no family for it, and there is none at all for the contact
    of a tool without a force, which does not touch the body.  ``least_bound`` is the share of the
    largest friction bound that no bound is smaller than, and ``share`` that of friction that acts.
    Collective.
    """
    penalty = target.penalty
    data, space = system.data, system.u.function_space
    strains: list[StrainOperator] = []
    families: list[Family] = []
    for number, item in enumerate(data.sets):
        if not on_any_rank(system.comm, item.inverse_limit.x.array > 0.0):
            continue
        strains.append(StrainOperator(space, data, item, system.kept))
        made = next(cones for law, cones in _CONES.items() if isinstance(item, law))
        families.append(made(strains[-1], penalty.compliance, number))
    bounds = []
    resting = [tool.contact for tool in system.tools if not tool.acts]
    for number, contact in enumerate(system.contacts):
        if contact in resting:
            continue
        nodes = ContactNodes(contact, number, system)
        pressing = ContactCones(nodes, penalty.epsilon, target.length)
        families.append(pressing)
        if not contact.friction.frictionless:
            regularisation = penalty.regularisations[number]
            rubbing = FrictionCones(nodes, regularisation, target.length)
            families.append(rubbing)
            bounds.append(MovingBound(system, contact, pressing, rubbing, least_bound, share))
    return Families(families, bounds, strains)


class Iterate:
    """The system's displacement, and the points of the families that take part, together.

    Products on Gamma_C are per area; means and targets are per volume, so that the scale of the
    family goes between.
    """

    def __init__(self, tangent: Tangent, band: tuple[float, float]) -> None:
        self.tangent, self.comm, self._band = tangent, tangent.comm, band
        self.families = [family for family in tangent.families if family.takes_part]
        self.cones = Composite(self.families)
        self._measure = float(self.comm.allreduce(self.cones.measure)) or 1.0

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
        self.cones.linearise()
        self.tangent.refresh()

    def direction(
        self, target: float, accuracy: float, corrections: FloatArray | None = None
    ) -> Direction:
        """The steps of displacement and families towards products of ``target``; collective."""
        aims = self.aims(target, corrections)
        return self._direction_of(self.tangent.solve_step(aims, accuracy))

    def direction_with(
        self, displacement: FloatArray, target: float, corrections: FloatArray | None
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
        steps = zip(self.families, self.cones.steps(direction.step), strict=True)
        reactions = [
            Reaction(family, family.reactions_of(family.z + t * step.dual))
            for family, step in steps
        ]
        du = self.tangent.step_after(t * direction.displacement, reactions, accuracy)
        return direction.plus(self._direction_of(du).plus(at_rest, -1.0), 1.0 / t)

    def aims(self, target: float, corrections: FloatArray | None) -> list[Reaction]:
        """The reactions that steps towards products of ``target`` lead to if nothing moves."""
        aims = self.cones.of_seen(self.cones.aim(target, corrections))
        return [Reaction(*pair) for pair in zip(self.families, aims, strict=True)]

    def _direction_of(self, du: FloatArray) -> Direction:
        """The steps of the families with a step of the displacement, towards what they aim at."""
        seen = joined(family.see(du) for family in self.families)
        return Direction(du, self.cones.step(seen), self.cones)

    def recentring(self, reach: float, direction: Direction, target: float) -> FloatArray:
        """The corrections that lead products after a step of ``reach`` nearer to ``target``."""
        band = self._band[0] * target, self._band[1] * target
        return -self.cones.recentring(reach, direction.step, band)

    def longest_step(self, direction: Direction) -> float:
        """How far a direction leads before a cone ends; collective."""
        return minimum(self.comm, self.cones.longest_step(direction.step))

    def longest_step_of_most(self, direction: Direction, share: float) -> float:
        """How far a direction leads, 1 at most, before a larger share of cones ends; collective."""
        speeds = self.cones.speeds(direction.step)
        few = int(share * self.comm.allreduce(len(speeds)))
        return 1.0 / exceeded_by_few(self.comm, speeds, few, 1.0)

    def advance(self, t: float, direction: Direction) -> None:
        """Take a step of length t; collective."""
        self.tangent.move(t, direction.displacement)
        self.cones.advance(t, direction.step)

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
        local = self.cones.total(t, None if direction is None else direction.step)
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
        return maximum(self.comm, self.cones.largest_multiplier())

    def describe_excess(self) -> str:
        """Which limit the displacement visited last exceeds, and where; collective."""
        reasons = [family.describe_excess() for family in self.limits_of_strain]
        return next(filter(None, reasons), "the foundation is in the way")
