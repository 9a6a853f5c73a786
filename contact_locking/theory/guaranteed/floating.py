"""The tractions that loads and contacts prescribe, balanced along motions that no condition holds.

The data must do no work along these motions; otherwise no stress balances the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.parallel import maximum
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.problem.rigidity.motions import free_motions
from contact_locking.theory.guaranteed.contact_tractions import ContactTractions
from contact_locking.theory.guaranteed.data_oscillation import BalancedLoads
from contact_locking.theory.guaranteed.facet_polynomials import legendre_moments
from contact_locking.theory.guaranteed.hybrid_system import Forces
from contact_locking.theory.guaranteed.macro_element import MacroElement, between
from contact_locking.theory.guaranteed.triangles import Triangles

# Pressures that balance the data differ from those of the solution by less than this share.
_LARGEST_CHANGE = 0.5
# A Gram matrix of the normal components of motions with a smaller eigenvalue is singular.
_SINGULAR = 1e-10


def forces_in_balance(
    problem: DiscreteProblem,
    triangles: Triangles,
    element: MacroElement,
    held: BoolArray,
    loads: BalancedLoads,
    contacts: list[ContactTractions],
) -> tuple[Forces, list[ContactTractions]]:
    """The tractions of loads and contacts, and the contacts with pressures in balance; collective.

    ``held`` (n, 3, 2) marks the prescribed components.  Each control value of a pressure is
    multiplied by ``1 + c . nu`` with one free motion c of the part, so that the data do no work
    along free motions.  One facet of Gamma_C of each part has springs, as many as there are free
    motions.  Raises NotApplicable if a factor would be far from 1, and where friction alone resists
    a motion.
    """
    comm, size = triangles.domain.comm, 2 * (element.degree + 1)
    turned = triangles.signs[:, :, None, None] ** np.arange(element.degree + 1)[:, None]
    springs = np.zeros((len(triangles.areas), 3, size, size))
    for part in _floating_parts(problem, triangles):
        modes = part.on_facets(triangles, element.degree)
        contacts = _balanced(part, modes, triangles, element, loads, contacts)
        # As the data are balanced, no spring has a force.
        facet = _facet_of(part, contacts, comm)
        if facet is not None:
            shapes = (modes * turned)[:, *facet].reshape(len(modes), -1)
            shapes /= np.linalg.norm(shapes, axis=1)[:, None]
            springs[facet] += problem.material.stiffness * shapes.T @ shapes
    moments = loads.moments.copy()
    for contact in contacts:
        np.add.at(moments, (contact.cells, contact.sides), contact.moments(element.degree))
    return Forces(held, loads.body, moments * turned, springs), contacts


@dataclass(frozen=True)
class _FloatingPart:
    """A connected part of the body with f free motions; ``motions`` (3, f) are coefficients.

    ``cells`` (n,) marks the triangles of the part.
    """

    motions: FloatArray
    cells: BoolArray

    def at(self, points: FloatArray) -> FloatArray:
        """The motions (f, ..., 2) at points (..., 2)."""
        x, y = points[..., 0], points[..., 1]
        one, zero = np.ones_like(x), np.zeros_like(x)
        basis = np.stack([np.stack(v, axis=-1) for v in ((one, zero), (zero, one), (-y, x))])
        return np.einsum("m...,mf->f...", basis, self.motions)

    def on_facets(self, triangles: Triangles, degree: int) -> FloatArray:
        """The Legendre coefficients (f, n, 3, k + 1, 2) of the motions on the facets of all cells.

        They are zero in cells of other parts.
        """
        values = self.at(triangles.ends)
        found = legendre_moments(values.reshape(-1, 2, 2), degree)
        return found.reshape(*values.shape[:3], -1, 2) * self.cells[:, None, None, None]


def _floating_parts(problem: DiscreteProblem, triangles: Triangles) -> list[_FloatingPart]:
    """The parts of the body that have free motions; collective."""
    space, domain = problem.u.function_space, problem.domain
    found = []
    for number in range(len(domain.part_names)):
        inside = domain.parts == number
        mark = np.zeros((len(problem.u.x.array) // 2, 2), dtype=bool)
        mark[space.dofmap.list[inside[: len(space.dofmap.list)]].reshape(-1)] = True
        motions = free_motions(domain, space, problem.constraints, mark.reshape(-1))
        if motions.shape[1]:
            found.append(_FloatingPart(motions, inside[: len(triangles.areas)]))
    return found


def _balanced(
    part: _FloatingPart,
    modes: FloatArray,
    triangles: Triangles,
    element: MacroElement,
    loads: BalancedLoads,
    contacts: list[ContactTractions],
) -> list[ContactTractions]:
    """The contacts with pressures that balance the data along the motions of a part; collective."""
    comm, places = triangles.domain.comm, triangles.at(element.load_points)[part.cells]
    weight = np.einsum("ij,n->nij", element.load_mass, triangles.areas[part.cells] / 3.0)
    work = np.einsum("fntid,nij,ntjd->f", part.at(places), weight, loads.body[part.cells])
    work += np.einsum("fnsjd,nsjd->f", modes, loads.moments)
    gram, every = np.zeros((len(work), len(work))), []
    for contact in contacts:
        here, count = modes[:, contact.cells, contact.sides], contact.pressure.shape[1]
        work += np.einsum("fmjd,mjd->f", here, contact.moments(element.degree))
        ends = triangles.ends[contact.cells, contact.sides]
        points = between(ends, np.arange(count) / (count - 1.0))
        pushed = np.einsum("fmrd,md->fmr", part.at(points), contact.normal)
        pushed *= part.cells[contact.cells][:, None]
        every.append(pushed)
        vectors = (contact.pressure * pushed)[..., None] * contact.normal[:, None]
        moved = legendre_moments(vectors.reshape(-1, count, 2), element.degree).reshape(here.shape)
        gram += np.einsum("m,fmjd,gmjd->fg", contact.lengths, here, moved)
    factors = _factors(comm.allreduce(work), comm.allreduce(gram))
    changes = [np.einsum("f,fmr->mr", factors, pushed) for pushed in every]
    if maximum(comm, max(np.abs(item).max(initial=0.0) for item in changes)) > _LARGEST_CHANGE:
        raise NotApplicable("the contact pressures do not balance the loads")
    pairs = zip(contacts, changes, strict=True)
    return [replace(item, pressure=item.pressure * (1.0 + change)) for item, change in pairs]


def _factors(work: FloatArray, gram: FloatArray) -> FloatArray:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram * np.outer(scale, scale)
    if not np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0] > _SINGULAR:
        raise NotApplicable("friction alone holds a rigid motion")
    return np.asarray(np.linalg.solve(gram, work))


def _facet_of(
    part: _FloatingPart, contacts: list[ContactTractions], comm: MPI.Intracomm
) -> tuple[int, int] | None:
    """The cell and the side of one facet of Gamma_C of a part, None on other ranks; collective."""
    mine = [
        (int(cell), int(side))
        for contact in contacts
        for cell, side in zip(contact.cells, contact.sides, strict=True)
        if part.cells[cell]
    ]
    first = comm.allreduce(comm.rank if mine else comm.size, op=MPI.MIN)
    return mine[0] if comm.rank == first else None
