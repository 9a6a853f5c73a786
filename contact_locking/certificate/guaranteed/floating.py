"""Rigid motions that no displacement condition holds: balance of the data, and springs.

The data must do no work along these motions; otherwise no stress balances the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.guaranteed.contact_tractions import ContactTractions
from contact_locking.certificate.guaranteed.facet_polynomials import (
    control_points,
    legendre_moments,
)
from contact_locking.certificate.guaranteed.macro_element import MacroElement
from contact_locking.certificate.guaranteed.triangles import Triangles
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.supports.rigid_motions import free_motions

# Pressures that balance the data differ from those of the solution by less than this share.
_LARGEST_CHANGE = 0.5
# A Gram matrix of the normal components of motions with a smaller eigenvalue is singular.
_SINGULAR = 1e-10


@dataclass(frozen=True)
class FloatingPart:
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


def floating_parts(problem: DiscreteProblem, triangles: Triangles) -> list[FloatingPart]:
    """The parts of the body that have free motions; collective."""
    space, domain = problem.u.function_space, problem.domain
    found = []
    for number in range(len(domain.part_names)):
        inside = domain.parts == number
        mark = np.zeros((len(problem.u.x.array) // 2, 2), dtype=bool)
        mark[space.dofmap.list[inside[: len(space.dofmap.list)]].reshape(-1)] = True
        motions = free_motions(domain, space, problem.constraints, mark.reshape(-1))
        if motions.shape[1]:
            found.append(FloatingPart(motions, inside[: len(triangles.areas)]))
    return found


def balance(
    parts: list[FloatingPart],
    triangles: Triangles,
    element: MacroElement,
    body: FloatArray,
    moments: FloatArray,
    contacts: list[ContactTractions],
) -> None:
    """Change the pressures so that the data do no work along free motions; collective.

    ``body`` (n, 3, l, 2) is the body force and ``moments`` (n, 3, k + 1, 2) the moments of all
    other tractions along the facets of the cells.  Each control value of the pressure is multiplied
    by ``1 + c . nu`` with one free motion c of the part.  Raises NotApplicable if this factor would
    be far from 1, and where friction alone resists a motion.
    """
    comm = triangles.domain.comm
    for part in parts:
        count = part.motions.shape[1]
        work, gram = np.zeros(count), np.zeros((count, count))
        places = triangles.at(element.load_points)[part.cells]
        weight = np.einsum("ij,n->nij", element.load_mass, triangles.areas[part.cells] / 3.0)
        work += np.einsum("fntid,nij,ntjd->f", part.at(places), weight, body[part.cells])
        work += _work(part, triangles, moments[part.cells])
        own = []
        for contact in contacts:
            inside = part.cells[contact.cells]
            own.append(inside)
            here = np.zeros_like(moments)
            np.add.at(here, (contact.cells, contact.sides), contact.moments(element.degree))
            work += _work(part, triangles, here[part.cells])
            pushed = np.einsum("fmrd,md->fmr", part.at(contact.places), contact.normal)
            for f in range(count):
                pressure = contact.pressure * pushed[f] * inside[:, None]
                vectors = pressure[:, :, None] * contact.normal[:, None]
                here[:] = 0.0
                moved = contact.lengths[:, None, None] * legendre_moments(vectors, element.degree)
                np.add.at(here, (contact.cells, contact.sides), moved)
                gram[:, f] += _work(part, triangles, here[part.cells])
        work, gram = comm.allreduce(work), comm.allreduce(gram)
        factors = _factors(work, gram)
        largest = 0.0
        for contact, inside in zip(contacts, own, strict=True):
            pushed = np.einsum("fmrd,md->fmr", part.at(contact.places), contact.normal)
            change = np.einsum("f,fmr->mr", factors, pushed) * inside[:, None]
            largest = max(largest, float(np.abs(change).max(initial=0.0)))
            contact.pressure = contact.pressure * (1.0 + change)
        if comm.allreduce(largest, op=MPI.MAX) > _LARGEST_CHANGE:
            raise NotApplicable("the contact pressures do not balance the loads")


def _factors(work: FloatArray, gram: FloatArray) -> FloatArray:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram * np.outer(scale, scale)
    if not np.linalg.eigvalsh(0.5 * (scaled + scaled.T))[0] > _SINGULAR:
        raise NotApplicable("friction alone holds a rigid motion")
    return np.asarray(np.linalg.solve(gram, work))


def _work(part: FloatingPart, triangles: Triangles, moments: FloatArray) -> FloatArray:
    """The work (f,) of moments (n, 3, k + 1, 2) along the motions."""
    return np.einsum("fnsjd,nsjd->f", _on_facets(part, triangles, moments.shape[2]), moments)


def _on_facets(part: FloatingPart, triangles: Triangles, count: int) -> FloatArray:
    """The Legendre coefficients (f, n, 3, k + 1, 2) of the motions on the facets of the cells."""
    ends = triangles.ends[part.cells]
    values = part.at(control_points(ends.reshape(-1, 2, 2), 1))
    found = np.stack([legendre_moments(motion, count - 1) for motion in values])
    return found.reshape(len(found), len(ends), 3, count, 2)


def springs(
    parts: list[FloatingPart],
    triangles: Triangles,
    element: MacroElement,
    contacts: list[ContactTractions],
    stiffness: float,
) -> FloatArray | None:
    """The blocks (n, 3, b, b) of springs that fix the free motions; None if there are none.

    One facet of Gamma_C of each part has springs, as many as there are free motions.  As the data
    are balanced, no spring has a force.  Collective.
    """
    if not parts:
        return None
    comm, size = triangles.domain.comm, 2 * (element.degree + 1)
    found = np.zeros((len(triangles.areas), 3, size, size))
    for part in parts:
        mine = [
            (cell, side)
            for contact in contacts
            for cell, side in zip(contact.cells, contact.sides, strict=True)
            if part.cells[cell]
        ]
        first = comm.allreduce(comm.rank if mine else comm.size, op=MPI.MIN)
        if comm.rank != first:
            continue
        cell, side = mine[0]
        only = np.zeros_like(part.cells)
        only[cell] = True
        modes = _on_facets(FloatingPart(part.motions, only), triangles, element.degree + 1)[
            :, 0, side
        ]
        modes = modes * triangles.signs[cell, side] ** np.arange(element.degree + 1)[:, None]
        flat = modes.reshape(len(modes), -1)
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        found[cell, side] += stiffness * flat.T @ flat
    return found
