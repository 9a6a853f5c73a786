"""The families of cones of a system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.contact_cones import ContactCones
from contact_locking.solver.interior_point.contact_nodes import ContactNodes
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.interior_point.locking_cones import LockingCones
from contact_locking.solver.interior_point.lorentz import Lorentz
from contact_locking.solver.interior_point.moving_bound import MovingBound
from contact_locking.solver.interior_point.strain_operator import StrainOperator
from contact_locking.solver.target import Target


@dataclass(frozen=True)
class Families:
    """All families of a system, and what ties friction to the pressure of its contact.

    A family of cones of another kind is one more entry of the list that :func:`families_of` makes.
    """

    every: list[Family]
    bounds: list[MovingBound]
    strains: StrainOperator
    nodes: list[ContactNodes]

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self.strains.destroy()
        for item in self.nodes:
            item.destroy()


def families_of(system: PenalisedSystem, target: Target, least_bound: float) -> Families:
    """Locking, and for each part of Gamma_C contact and, where there is any, friction; collective.

    ``least_bound`` is the share of the largest friction bound that no bound is smaller than.
    """
    lorentz, penalty = Lorentz(system.comm), target.penalty
    strains, limit = _strains(system)
    families: list[Family] = [LockingCones(lorentz, strains, limit, penalty.compliance)]
    bounds, touching = [], []
    for number, contact in enumerate(system.contacts):
        nodes = ContactNodes(contact, number, system)
        touching.append(nodes)
        pressing = ContactCones(nodes, penalty.epsilon, target.length)
        families.append(pressing)
        if not contact.friction.frictionless:
            regularisation = penalty.regularisations[number]
            rubbing = FrictionCones(lorentz, nodes, regularisation, target.length)
            families.append(rubbing)
            bounds.append(MovingBound(system.u, contact, pressing, rubbing, least_bound))
    return Families(families, bounds, strains, touching)


def _strains(system: PenalisedSystem) -> tuple[StrainOperator, FloatArray]:
    """The strains at the points that can lock, and M (k,) there; collective."""
    data, space = system.data, system.u.function_space
    topology = space.mesh.topology
    owned = topology.index_map(topology.dim).size_local
    # The degrees of freedom of the space of strains need not follow the numbers of the cells.
    by_cell = data.inverse_limit.function_space.dofmap.list[:owned]
    dofs = by_cell.reshape(-1)
    cells = np.repeat(np.arange(owned, dtype=np.int32), by_cell.shape[1])
    inverse_limit = data.inverse_limit.x.array[dofs]
    locks = inverse_limit > 0.0
    strains = StrainOperator(space, data, dofs[locks], cells[locks])
    return strains, 1.0 / inverse_limit[locks]
