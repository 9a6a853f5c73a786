"""The families of cones of a system: one for each set of strains, and two for each contact."""

from __future__ import annotations

from dataclasses import dataclass

from contact_locking.parallel import on_any_rank
from contact_locking.problem.strain_sets import HalfSpaceSet, NormSet, StrainSet
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.bound_step import MovingBound
from contact_locking.solver.interior_point.contact_cones import (
    ContactCones,
    ContactNodes,
    FrictionCones,
)
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.locking_cones import (
    LockingCones,
    StrainHalfLines,
    StrainOperator,
)
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
