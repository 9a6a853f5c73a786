"""The rigid motions of the body, and those that conditions, contacts and friction do not stop.

A motion is given by its coefficients (f,) of the f motions that the conditions leave free; linear
programmes find those that contact and friction do not stop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import AXES, BoolArray, FloatArray
from contact_locking.contact.nodal_contact import BoundsInForce, NodalContact
from contact_locking.contact.travel import Travel
from contact_locking.mesh.distribution import marked
from contact_locking.mesh.domain import Domain
from contact_locking.supports.conditions import Constraints

# Motions with a smaller eigenvalue of the scaled Gram matrix count as zero.
_NONE = 1e-12
# The share of prescribed values that rounding may take from a rigid motion.
_STRAINED = 1e-12

# A component of a motion below this share of the others is not mentioned.
_SHARE = 0.2
# Coordinates below this share of the size of the body are zero.
_ROUNDING = 1e-6


def rigid_motions(
    space: fem.FunctionSpace, axisymmetric: bool = False, centre: FloatArray | float = 0.0
) -> FloatArray:
    """The translations and the rotations about a centre, as values at the local dofs.

    The shape is (3, k) in 2D and (6, k) in 3D, with the k local dofs, ghosts included.  An
    axisymmetric body has one rigid motion, the translation along its axis.
    """
    x = space.tabulate_dof_coordinates() - centre
    dim = space.mesh.topology.dim
    motions = np.zeros((dim + dim * (dim - 1) // 2, len(x), dim))
    for i in range(dim):
        motions[i, :, i] = 1.0
    pairs = [(i, j) for i in range(dim) for j in range(i + 1, dim)]
    for k, (i, j) in enumerate(pairs):
        motions[dim + k, :, i] = -x[:, j]
        motions[dim + k, :, j] = x[:, i]
    if axisymmetric:
        motions = motions[1:2]
    return motions.reshape(len(motions), -1)


def free_motions(
    domain: Domain, space: fem.FunctionSpace, constraints: Constraints, dofs: BoolArray
) -> FloatArray:
    """Coefficients (m, f) of the f rigid motions that the conditions leave free; collective.

    The conditions are those of one part of the body; ``dofs`` marks the local dofs of the part.
    """
    motions = rigid_motions(space, domain.axisymmetric)
    owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    held = constraints.dofs[constraints.dofs < owned]
    fixed = motions[:, held[dofs[held]]]
    everything = motions[:, :owned][:, dofs[:owned]]
    directions = constraints.directions
    if constraints.oblique:
        # Conditions by component are already counted at their nodes.
        along = np.array([directions.part_of(motion * dofs)[:owned] for motion in motions])
        along[:, held] = 0.0
        fixed = np.column_stack([fixed, along])
    gram = domain.comm.allreduce(fixed @ fixed.T)
    # A rotation about the origin has large values far away.
    return null_motions(gram, domain.comm.allreduce(np.sum(everything**2, axis=1)))


def null_motions(gram: FloatArray, sizes: FloatArray) -> FloatArray:
    """Coefficients (m, f) of the f motions for which a Gram matrix (m, m) vanishes.

    ``sizes`` (m,) are the squared norms by which the motions are scaled.
    """
    scale = 1.0 / np.sqrt(np.where(sizes > 0.0, sizes, 1.0))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors[:, values <= _NONE])


def dofs_of(domain: Domain, space: fem.FunctionSpace, number: int) -> BoolArray:
    """The local dofs of a part's cells, ghosts included; collective."""
    dofmap = space.dofmap
    # A rank may have a node of the part without a cell of the part.
    marks = marked(dofmap.index_map, dofmap.list[np.flatnonzero(domain.parts == number)])
    return np.repeat(marks, dofmap.index_map_bs)


def prescribed_motion(constraints: Constraints, values: FloatArray) -> FloatArray | None:
    """The rigid motion with the prescribed values, None if they strain the body; collective.

    ``values`` (k,) is a displacement with the prescribed values, and the motion (k,) has values at
    all local dofs.  It contains no motion that the conditions leave free.
    """
    space, comm = constraints.space, constraints.space.mesh.comm
    size = space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local * size

    def held_part(displacement: FloatArray) -> FloatArray:
        return constraints.held_part(displacement[:owned]).reshape(-1, size)

    nodes = np.flatnonzero(np.any(held_part(np.ones(owned)), axis=1))
    held_at = space.tabulate_dof_coordinates()[nodes]
    # About the centre of what is held, so that one held node asks for no rotation.
    total = comm.allreduce(np.append(held_at.sum(axis=0), len(held_at)))
    centre = total[:3] / max(total[3], 1.0)
    motions = rigid_motions(space, centre=centre)
    rows = [held_part(motion)[nodes].reshape(-1) for motion in (*motions, values)]
    local = np.linalg.qr(np.column_stack(rows), mode="r")
    *columns, aim = np.vstack(comm.allgather(local)).T
    # The least of the motions that fit turns with the body: rotations count by their displacements.
    local_square = float(np.sum((held_at - centre) ** 2))
    length = np.sqrt(comm.allreduce(local_square) / max(total[3], 1.0)) or 1.0
    scale = np.where(np.arange(len(columns)) < size, 1.0, length)
    scaled = np.column_stack(columns) / scale
    coefficients = np.linalg.lstsq(scaled, aim, rcond=1e-10)[0]
    if np.linalg.norm(scaled @ coefficients - aim) > _STRAINED * np.linalg.norm(aim):
        return None
    return np.asarray((coefficients / scale) @ motions)


def spin(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The velocity of the origin (3,) and the spin (3,) of a rigid motion.

    ``motion`` are coefficients of :func:`rigid_motions`: translations, then rotations in the planes
    (x, y), (x, z) and (y, z).
    """
    if len(motion) == 1:
        return np.array([0.0, motion[0], 0.0]), np.zeros(3)
    if len(motion) == 3:
        return np.array([*motion[:2], 0.0]), np.array([0.0, 0.0, motion[2]])
    return np.asarray(motion[:3]), np.array([motion[5], -motion[4], motion[3]])


def describe_motion(motion: FloatArray, box: FloatArray) -> str:
    """A rigid motion in words, with the place of its axis for a rotation.

    ``motion`` (3 or 6 coefficients, 1 of an axisymmetric body) is as in :func:`spin`, and ``box``
    (2, d) are the least and greatest coordinates of the body.
    """
    if len(motion) == 1:
        return "translation along y, the axis"
    dim = box.shape[1]
    at_origin, turn = spin(motion)
    middle, size = np.zeros(3), float(np.linalg.norm(np.ptp(box, axis=0)))
    middle[:dim] = box.mean(axis=0)
    moved = at_origin + np.cross(turn, middle)
    rate = float(np.linalg.norm(turn))
    if 0.5 * size * rate < _SHARE * np.linalg.norm(moved):
        return f"translation along {axes_of(moved)}"
    along = moved @ turn / rate**2 * turn
    place = middle + np.cross(turn, moved) / rate**2
    if dim == 2:
        return f"rotation about {point(place[:2], size)}"
    words = f"rotation about the line along {axes_of(turn)} through {point(place, size)}"
    if np.linalg.norm(along) < _SHARE * 0.5 * size * rate:
        return words
    return f"translation along {axes_of(along)} with {words}"


def point(place: Iterable[float], size: float) -> str:
    """A point of a body of some size, to five digits: (40, 0)."""
    shown = [0.0 if abs(x) < _ROUNDING * size else x for x in place]
    return "(" + ", ".join(f"{x:.5g}" for x in shown) + ")"


def axes_of(direction: FloatArray) -> str:
    """The axes along which a direction has a part: x and y."""
    share = np.abs(direction) / np.abs(direction).max()
    return " and ".join(axis for axis, size in zip(AXES, share, strict=False) if size > _SHARE)


class MotionsAtContact:
    """Rigid motions at the owned nodes of one contact on some parts of the body.

    They are relative to the tool, or to the other body.  ``owned`` marks the nodes among those of
    the contact.
    """

    def __init__(
        self, contact: NodalContact, motions: FloatArray, dofs: BoolArray, tools: Sequence[Travel]
    ) -> None:
        self.contact, self.owned = contact, contact.surface.is_of(dofs)
        surface, dim = contact.surface, contact.surface.domain.dim
        at_nodes = np.array([surface.of_motion(motion) for motion in motions])
        of_body = at_nodes.reshape(len(motions), len(self.owned), dim)[:, self.owned]
        of_tools = np.zeros((len(tools), *of_body.shape[1:]))
        for number, tool in enumerate(tools):
            if tool.contact is contact:
                of_tools[number] = -tool.direction
        self._motions = np.concatenate([of_body, of_tools])
        #: The normal components (k, f).
        self.normals = np.einsum("fkd,kd->kf", self._motions, contact.normals[self.owned])

    def gram(self) -> FloatArray:
        """The products (f, f) of the motions, summed over the nodes of this rank."""
        return np.asarray(np.einsum("fkd,gkd->fg", self._motions, self._motions))

    def tangents(self) -> FloatArray:
        """The tangential components (k d, f) at the nodes with friction."""
        rows = 0 if self.contact.friction.frictionless else len(self.normals)
        along = self._along[:, :rows]
        return along.reshape(len(along), -1).T

    def knows_friction(self) -> bool:
        """Whether the bound at any pressure p >= 0 is known before a solve; collective.

        That is if mu does not depend on the slip, as stated by the law, and R has no negative
        entry.
        """
        bound = self.contact.friction
        if bound.frictionless:
            return True
        return bound.is_coulomb and not bound.depends_on_slip and bound.smoothing.is_positive()

    def resistance(self, motion: FloatArray) -> FloatArray:
        """The derivative (k, f) of ``c_nu + R* (mu |c_tau|)`` at a motion (f,); collective."""
        contact = self.contact
        if contact.friction.frictionless:
            return self.normals
        mu = contact.friction.coefficient(np.zeros(len(self.owned))) * contact.free
        rubbed = np.zeros((len(motion), len(self.owned)))
        rubbed[:, self.owned] = self._towards(motion)
        taken = np.array([contact.friction.smoothing.adjoint(mu * row) for row in rubbed])
        return np.asarray(self.normals + taken[:, self.owned].T)

    def rub(self, motion: FloatArray, bounds: BoundsInForce) -> FloatArray:
        """The derivative (f,) of ``int G |c_tau|`` at a motion c (f,), local."""
        work = self.contact.surface.weights * bounds[self.contact]
        return self._towards(motion) @ work[self.owned]

    @cached_property
    def _along(self) -> FloatArray:
        """The tangential parts (f, k, d)."""
        normals = self.contact.normals[self.owned]
        return self._motions - np.einsum("kf,kd->fkd", self.normals, normals)

    def _towards(self, motion: FloatArray) -> FloatArray:
        """The derivative (f, k) of ``|c_tau|`` at a motion (f,)."""
        slip = np.einsum("fkd,f->kd", self._along, motion)
        size = np.linalg.norm(slip, axis=1)
        unit = slip / np.where(size > 0.0, size, 1.0)[:, None]
        return np.asarray(np.einsum("fkd,kd->fk", self._along, unit))


# The most rounds of the search for a motion that friction does not stop.  In 2D a few suffice.
_CUTS = 40
# The share of the net work of loads and friction by which a slide may miss the most.
_NEAR = 1e-4
# The tolerance of a motion in the rows of previous rounds.
_FEASIBLE = 1e-10
# A scale that is zero is replaced by this number.
_TINY = 1e-300


def loose_motion(
    contact: FloatArray, tangents: FloatArray, rubs: BoolArray, work: FloatArray
) -> FloatArray | None:
    """A rigid motion (f,) without resistance, None if there is none.

    ``contact`` (k, f) are the normal components of the f free motions at the nodes of Gamma_C,
    ``rubs`` (k,) marks the nodes with friction, ``tangents`` (n, f) are the tangential components
    at these nodes, and ``work`` (f,) is the work of the loads along the motions.

    Without friction a minimiser exists if there is no motion c != 0 with ``contact c <= 0`` (the
    body leaves the foundation or slides along it) and ``work . c >= 0`` (the loads do not resist).
    With friction the bound is not known yet: a motion counts only if it leaves the foundation at
    all nodes with friction, ``contact c < 0``, and slides at none, so that friction does no work.
    """
    normal, push = _scaled(contact), _scaled(work)
    rows = np.vstack([normal, -push])
    if not rubs.any():
        slides = sliding_motions(normal)
        if slides.size:
            along = slides @ (slides.T @ push)
            return np.asarray(along if np.any(along) else slides[:, 0])
        axes = np.eye(len(work))
        motions = (_unresisted(rows, aim) for aim in (push, *axes, *-axes))
        return next((motion for motion in motions if motion is not None), None)
    straight = sliding_motions(tangents)
    leaving = _leaving(rows @ straight, np.append(rubs, False)) if straight.size else None
    if leaving is None:
        return None
    # Of the motions away from the foundation the loads drive this one most: about an edge.
    driven = _unresisted(rows @ straight, push @ straight)
    return np.asarray(straight @ (leaving if driven is None else driven))


def _scaled(values: FloatArray) -> FloatArray:
    return np.asarray(values / _size_of(values), dtype=float)


def _size_of(values: FloatArray) -> float:
    """The largest entry, above zero."""
    return max(float(np.abs(values).max(initial=0.0)), _TINY)


def _best(
    aim: FloatArray, rows: FloatArray, room: float = 0.0, bounds: Sequence[Any] = (-1, 1)
) -> tuple[FloatArray, float] | None:
    """The c with ``rows c <= room`` and the largest ``aim . c``, and this number; else None."""
    # Few bodies have free motions, and the import takes a tenth of a second.
    from scipy.optimize import linprog

    options = {"primal_feasibility_tolerance": _FEASIBLE}
    room_of_rows = np.full(len(rows), room)
    result = linprog(-aim, A_ub=rows, b_ub=room_of_rows, bounds=bounds, options=options)
    return (np.asarray(result.x), float(-result.fun)) if result.status == 0 else None


def _unresisted(rows: FloatArray, aim: FloatArray) -> FloatArray | None:
    """The motion c with ``rows c <= 0`` and the largest ``aim . c``; None if all have 0."""
    best = _best(aim, rows, 1e-9)
    return None if best is None or best[1] <= 1e-3 else best[0]


def _leaving(rows: FloatArray, rubs: BoolArray) -> FloatArray | None:
    """The motion c with ``rows c <= 0`` and the least maximum of ``rows c`` over the rows that rub.

    None if the least maximum is 0.
    """
    count = rows.shape[1]
    every, bounds = np.column_stack([rows, rubs.astype(float)]), [(-1, 1)] * count + [(0, 1)]
    best = _best(np.append(np.zeros(count), 1.0), every, 1e-9, bounds)
    return None if best is None or best[1] <= 1e-3 else best[0][:count]


def sliding_motions(components: FloatArray) -> FloatArray:
    """Coefficients (f, m) of the motions without components on Gamma_C, orthonormal.

    ``components`` (k, f) are the normal, or tangential, components of f motions at nodes.
    """
    if not components.size:
        return np.eye(components.shape[1])
    # The triangle has the singular vectors of the rows, of which there may be many.
    _, sizes, directions = np.linalg.svd(np.linalg.qr(components, mode="r"))
    sizes = np.append(sizes, np.zeros(components.shape[1] - len(sizes)))
    return np.asarray(directions[sizes <= 1e-9 * _size_of(sizes)].T)


def unheld_motion(
    normals: FloatArray, resistance: Callable[[FloatArray], FloatArray], work: FloatArray
) -> FloatArray | None:
    """A motion c (f,) with ``r(c) <= 0`` at all nodes and ``work . c > 0``; None if none is found.

    ``r(c) = normals c + s(c) >= normals c`` is convex and homogeneous of degree 1; ``resistance``
    gives the rows (n, f) that are its derivative, with which ``rows c = r(c)``.  By cutting planes:
    each motion is the best for the derivatives at the earlier ones, which are lower bounds of r.
    """
    size = _size_of(normals)
    rows, push = _scaled(normals), _scaled(work)
    for _ in range(_CUTS):
        best = _best(push, rows)
        if best is None or best[1] < 1e-3:
            return None
        motion = best[0]
        cut = resistance(motion) / size
        if np.all(cut @ motion <= 1e-9):
            return motion
        rows = np.vstack([rows, cut])
    return None


def driven_motion(
    some: FloatArray, normals: FloatArray, work: FloatArray, rub: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """The motion c (f,) with ``normals c <= 0`` and the largest ``work . c - s(c)``, in a unit box.

    The search is among the combinations of the motions ``some`` (f, m).  ``s(c) = int G |c_tau|``
    is convex and homogeneous; ``rub`` gives its derivative (f,) at a motion: ``rub(c) . c = s(c)``.
    Each motion is the best for the derivatives at the earlier ones, lower bounds of s.
    """
    push = some.T @ work
    size, count = _size_of(push), some.shape[1]
    leaving = np.pad(normals @ some, ((0, 0), (0, 1)))
    leaving /= _size_of(leaving)
    cuts: list[FloatArray] = []
    best: FloatArray = np.zeros(count)
    most = -np.inf
    for _ in range(_CUTS):
        rows = np.vstack([leaving, *(np.append(cut, -1.0) for cut in cuts)])
        result = _best(np.append(push / size, -1.0), rows, bounds=[(-1, 1)] * count + [(0, None)])
        if result is None:
            # The push is rounding compared with friction.
            break
        motion, above = result[0][:count], result[1]
        cuts.append(np.asarray(some.T @ rub(some @ motion) / size))
        net = float((push / size - cuts[-1]) @ motion)
        if net > most:
            best, most = motion, net
        if above - most <= _NEAR * abs(above):
            break
    return np.asarray(some @ best)
