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
from contact_locking.solver.interior_point.family import Direction, Family, Reactions
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
    """All families of a system; :func:`families_of` makes them, also those of a new kind.

    - ``every``: all families
    - ``bounds``: the friction bounds, which tie friction to the pressure of a contact
    - ``strains``: the operator of each set of strains that limits a point
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
    """One family for each set of strains, and for contact and friction on each part of Gamma_C.

    There is none for a set without a limit anywhere, for a friction coefficient of zero, and for a
    pushed foundation without a force, which does not touch the body.  Collective.

    - ``least_bound``: the least friction bound over the largest
    - ``share``: the share of the friction coefficient that acts
    """
    penalty = target.penalty
    data, space = system.data, system.u.function_space
    strains: list[StrainOperator] = []
    families: list[Family] = []
    for number, law in enumerate(data.sets):
        if not on_any_rank(system.comm, law.inverse_limit.x.array > 0.0):
            continue
        strains.append(StrainOperator(space, data, law, system.kept))
        cones = next(cones for kind, cones in _CONES.items() if isinstance(law, kind))
        families.append(cones(strains[-1], penalty.compliance, number))
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
    """The system's displacement, and the points and multipliers of all active families.

    Targets and means of products are per volume; families convert them by their scale.  Methods
    are collective.
    """

    def __init__(self, tangent: Tangent) -> None:
        self.tangent, self.comm = tangent, tangent.comm
        self.families = [family for family in tangent.families if family.takes_part]
        self.cones = Composite(self.families)
        self.measure = float(self.comm.allreduce(self.cones.measure)) or 1.0

    @property
    def is_finite(self) -> bool:
        """Whether all points and multipliers are finite."""
        arrays = [values for family in self.families for values in (family.x, family.z)]
        return on_every_rank(self.comm, all(bool(np.isfinite(each).all()) for each in arrays))

    def soften(self, softness: float) -> None:
        """Let steps have at least the compliance ``softness``, a strain over a stress."""
        for family in self.families:
            family.softness = softness * family.scale

    def linearise(self) -> None:
        """Assemble the tangent at the present iterate."""
        self.cones.linearise()
        self.tangent.refresh()

    def direction(
        self, target: float, accuracy: float, corrections: FloatArray | None = None
    ) -> Direction:
        """The steps of displacement and families towards products of ``target``."""
        aims = self.aims(target, corrections)
        return self._direction_of(self.tangent.solve_step(aims, accuracy))

    def direction_with(
        self, displacement: FloatArray, target: float, corrections: FloatArray | None
    ) -> Direction:
        """The steps of the families for a known step of the displacement."""
        self.aims(target, corrections)
        return self._direction_of(displacement)

    def balanced(self, direction: Direction, t: float, accuracy: float) -> Direction:
        """The direction changed so that a step of length t balances the forces.

        Forces are linear in displacement and multipliers; products change in second order.
        """
        at_rest = self._direction_of(self.tangent.zeros())
        steps = self.cones.of_points(t * direction.step.dual)
        reactions = {family: family.reactions_of(family.z + step) for family, step in steps.items()}
        du = self.tangent.step_after(t * direction.displacement, reactions, accuracy)
        return direction.plus(self._direction_of(du).plus(at_rest, -1.0), 1.0 / t)

    def aims(self, target: float, corrections: FloatArray | None) -> Reactions:
        """The reactions after a step towards products of ``target``, for du = 0."""
        return self.cones.of_seen(self.cones.aim(target, corrections))

    def _direction_of(self, du: FloatArray) -> Direction:
        """The steps of the families for a step du, towards their targets."""
        seen = joined(family.see(du) for family in self.families)
        return Direction(du, self.cones.step(seen), self.cones)

    def longest_step(self, direction: Direction) -> float:
        """The largest step length for which all points stay in their cones."""
        return minimum(self.comm, self.cones.longest_step(direction.step))

    def longest_step_of_most(self, direction: Direction, share: float) -> float:
        """The largest step length up to 1 for which at most this share of points leave cones."""
        speeds = self.cones.speeds(direction.step)
        few = int(share * self.comm.allreduce(len(speeds)))
        return 1.0 / exceeded_by_few(self.comm, speeds, few, 1.0)

    def advance(self, t: float, direction: Direction) -> None:
        """Take a step of length t."""
        self.tangent.move(t, direction.displacement)
        self.cones.advance(t, direction.step)

    def least_product(self) -> float:
        """The duality gap of products that are as small as rounding in the friction cones."""
        rubbing = [family for family in self.families if isinstance(family, FrictionCones)]
        least = max((family.least_product() for family in rubbing), default=0.0)
        return self.measure * maximum(self.comm, least)

    def mean_product(self, t: float = 0.0, direction: Direction | None = None) -> float:
        """The mean product over all cones after a step of length t."""
        local = self.cones.total(t, None if direction is None else direction.step)
        return float(self.comm.allreduce(local)) / self.measure

    @property
    def limits_of_strain(self) -> list[LimitsOfStrain]:
        return [family for family in self.families if isinstance(family, LimitsOfStrain)]

    def body_work(self) -> float:
        """``|int Z : eps(u)|``."""
        local = sum(family.power(family.reactions, family.seen) for family in self.limits_of_strain)
        return abs(float(self.comm.allreduce(local)))

    def primal_residual(self, deformation: float) -> float:
        """The largest relative primal gap, of lengths relative to ``deformation``."""
        return max(family.primal_residual(deformation) for family in self.families)

    def equilibrium_residual(self, scale: float, tolerance: float) -> float:
        """The unbalanced forces relative to ``scale``.

        A force below the rounding in the reactions counts as within the tolerance: a strain
        beyond its limit makes reactions large compared with loads and elastic forces.
        """
        reactions = {family: family.reactions for family in self.families}
        unbalanced, held = self.tangent.residual_norms(reactions)
        # Without any forces the scale may be 0.
        relative = unbalanced / max(scale, ROUNDING * held / tolerance) if unbalanced > 0.0 else 0.0
        return max(relative, self.tangent.tool_residual(reactions))

    def largest_multiplier(self) -> float:
        """The largest multiplier of a limit on the displacement."""
        return maximum(self.comm, self.cones.largest_multiplier())

    def describe_excess(self) -> str:
        """Which limit the displacement exceeds, and where, in words."""
        reasons = [family.describe_excess() for family in self.limits_of_strain]
        return next(filter(None, reasons), "the foundation is in the way")
