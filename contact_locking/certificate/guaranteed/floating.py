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
from contact_locking.problem.rigidity.motions import free_motions

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

    def on_facets(self, triangles: Triangles, degree: int) -> FloatArray:
        """The Legendre coefficients (f, n, 3, k + 1, 2) of the motions on the facets of all cells.

        They are zero in cells of other parts.
        """
        values = self.at(control_points(triangles.ends.reshape(-1, 2, 2), 1))
        found = np.stack([legendre_moments(motion, degree) for motion in values])
        return found.reshape(len(values), -1, 3, degree + 1, 2) * self.cells[:, None, None, None]


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
        count, modes = part.motions.shape[1], part.on_facets(triangles, element.degree)
        places = triangles.at(element.load_points)[part.cells]
        weight = np.einsum("ij,n->nij", element.load_mass, triangles.areas[part.cells] / 3.0)
        work = np.einsum("fntid,nij,ntjd->f", part.at(places), weight, body[part.cells])
        work += np.einsum("fnsjd,nsjd->f", modes, moments)
        gram, every = np.zeros((count, count)), []
        for contact in contacts:
            here = modes[:, contact.cells, contact.sides]
            work += np.einsum("fmjd,mjd->f", here, contact.moments(element.degree))
            pushed = np.einsum("fmrd,md->fmr", part.at(contact.places), contact.normal)
            pushed *= part.cells[contact.cells][:, None]
            every.append(pushed)
            for column, pressure in zip(gram.T, contact.pressure * pushed, strict=True):
                vectors = pressure[:, :, None] * contact.normal[:, None]
                moved = contact.lengths[:, None, None] * legendre_moments(vectors, element.degree)
                column += np.einsum("fmjd,mjd->f", here, moved)
        factors, largest = _factors(comm.allreduce(work), comm.allreduce(gram)), 0.0
        for contact, pushed in zip(contacts, every, strict=True):
            change = np.einsum("f,fmr->mr", factors, pushed)
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
        modes = part.on_facets(triangles, element.degree)[:, cell, side]
        modes = modes * triangles.signs[cell, side] ** np.arange(element.degree + 1)[:, None]
        flat = modes.reshape(len(modes), -1)
        flat /= np.linalg.norm(flat, axis=1)[:, None]
        found[cell, side] += stiffness * flat.T @ flat
    return found
