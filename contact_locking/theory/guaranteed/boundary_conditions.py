"""Whether the stresses in balance apply: to the mesh, and to values that hold on whole facets."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import BoolArray
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.parallel import maximum
from contact_locking.theory.guaranteed.contact_tractions import ContactTractions
from contact_locking.theory.guaranteed.facet_polynomials import bernstein
from contact_locking.theory.guaranteed.macro_element import FACET_ENDS, between, lagrange
from contact_locking.theory.guaranteed.triangles import Triangles

# Values are compared at so many points of each facet, both ends included.
_SAMPLES = 8
# Rounding relative to the largest displacement, and in distances relative to the body.
_ROUNDING, _ROUNDING_OF_DISTANCES = 1e-10, 1e-12


def require_straight_triangles(state: SolvedState) -> None:
    """Raise NotApplicable for a mesh on which there are no stresses in balance here."""
    domain, element = state.problem.domain, state.problem.element
    if state.dim != 2:
        raise NotApplicable(
            "not in three dimensions, where the system for the stress has about 20 unknowns a cell"
        )
    if domain.axisymmetric:
        raise NotApplicable("not for axisymmetric bodies, whose equilibrium has other terms")
    if element.boxes:
        raise NotApplicable("the stresses in equilibrium are for triangles, not quadrilaterals")


def held_components(state: SolvedState, triangles: Triangles) -> BoolArray:
    """(n, 3, 2) which components are prescribed on each facet; collective.

    Raises NotApplicable for supports along other directions than the axes, and if the displacement
    of the solution differs from the prescribed values at one of 8 points of a facet: the solution
    then does not have these values between the nodes.
    """
    held = np.zeros((*triangles.facets.shape, 2), dtype=bool)
    problem, worst, s = state.problem, 0.0, np.arange(_SAMPLES) / (_SAMPLES - 1.0)
    if problem.constraints.supports.placed:
        raise NotApplicable("a support holds a direction that is no axis")
    if problem.constraints.given:
        raise NotApplicable("conditions of DOLFINx prescribe values at nodes")
    samples, nodal = between(FACET_ENDS, s), triangles.at_nodes(problem.u)
    shapes = np.stack([lagrange(problem.element.degree, points) for points in samples])
    for item in problem.constraints.wanted:
        cells, sides = triangles.sides_on(problem.domain.facets(item.on, item.key))
        held[cells, sides, item.component] = True
        places = between(triangles.ends[cells, sides], s)
        wanted = item.value(places.reshape(-1, 2).T).reshape(len(cells), _SAMPLES)
        values = np.einsum("msi,mi->ms", shapes[sides], nodal[cells, :, item.component])
        worst = max(worst, float(np.abs(wanted - values).max(initial=0.0)))
    if maximum(state.comm, worst) > _ROUNDING * state.largest_displacement:
        raise NotApplicable("prescribed displacements are not met between the nodes")
    return held


def require_exact_gaps(
    state: SolvedState, triangles: Triangles, contacts: list[ContactTractions]
) -> None:
    """Raise NotApplicable if a gap differs from the polynomial through its nodes; collective.

    The values are compared at 8 points of each facet.
    """
    s, worst = np.arange(_SAMPLES) / (_SAMPLES - 1.0), 0.0
    for contact in contacts:
        places = between(triangles.ends[contact.cells, contact.sides], s)
        at_places = contact.fields.contact.foundation.gap(places.reshape(-1, 2).T)
        exact = at_places.reshape(len(places), _SAMPLES)
        own = np.einsum("mr,sr->ms", contact.gap, bernstein(contact.gap.shape[1] - 1, s))
        worst = max(worst, float(np.abs(exact - own).max(initial=0.0)))
    if maximum(state.comm, worst) > _ROUNDING_OF_DISTANCES * state.target.length:
        raise NotApplicable("the gap is not met between the nodes of the mesh")
