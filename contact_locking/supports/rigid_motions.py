"""The rigid motions of the body, and those that its conditions and contacts leave free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.mesh.domain import Domain
from contact_locking.supports.conditions import Constraints

# The most rounds of the search for a motion that friction does not stop.  In 2D a few suffice.
_CUTS = 40
# The share of the net work of loads and friction by which a slide may miss the most.
_NEAR = 1e-4
# The share of prescribed values that rounding may take from a rigid motion.
_STRAINED = 1e-12


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
    domain: Domain, space: fem.FunctionSpace, constraints: Constraints, part: BoolArray
) -> FloatArray:
    """Coefficients (m, f) of the f rigid motions that the conditions leave free; collective.

    The conditions are those of one part of the body; ``part`` marks the local dofs of the part.
    """
    motions = rigid_motions(space, domain.axisymmetric)
    owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    held = constraints.dofs[constraints.dofs < owned]
    fixed = motions[:, held[part[held]]]
    everything = motions[:, :owned][:, part[:owned]]
    directions = constraints.supports.directions
    if constraints.supports.placed:
        # The component conditions count at their nodes already.
        along = np.array([directions.part_of(motion * part)[:owned] for motion in motions])
        along[:, held] = 0.0
        fixed = np.column_stack([fixed, along])
    gram = domain.comm.allreduce(fixed @ fixed.T)
    # A rotation about the origin has large values far away.  The norm over the part scales each
    # motion.
    scale = 1.0 / np.sqrt(np.diag(domain.comm.allreduce(everything @ everything.T)))
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    return scale[:, None] * vectors[:, values <= 1e-12]


def prescribed_motion(constraints: Constraints, values: FloatArray) -> FloatArray | None:
    """The rigid motion that prescribed values make, None if they strain the body; collective.

    ``values`` (k,) is a displacement with the prescribed values, and the motion (k,) has values at
    all local dofs.  A motion that the conditions leave free is not in it.
    """
    space = constraints.space
    size = space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local * size

    def held_part(displacement: FloatArray) -> FloatArray:
        return constraints.held_part(displacement[:owned]).reshape(-1, size)

    nodes = np.flatnonzero(np.any(held_part(np.ones(owned)), axis=1))
    held_at = space.tabulate_dof_coordinates()[nodes]
    # About the centre of what is held, so that one held node asks for no rotation.
    total = space.mesh.comm.allreduce(np.append(held_at.sum(axis=0), len(held_at)))
    centre = total[:3] / max(total[3], 1.0)
    motions = rigid_motions(space, centre=centre)
    asked = [held_part(motion)[nodes].reshape(-1) for motion in (*motions, values)]
    local = np.linalg.qr(np.column_stack(asked), mode="r")
    *columns, aim = np.vstack(space.mesh.comm.allgather(local)).T
    # The least of the motions that fit turns with the body: rotations count by their displacements.
    local_square = float(np.sum((held_at - centre) ** 2))
    length = np.sqrt(space.mesh.comm.allreduce(local_square) / max(total[3], 1.0)) or 1.0
    scale = np.where(np.arange(len(columns)) < size, 1.0, length)
    scaled = np.column_stack(columns) / scale
    found = np.linalg.lstsq(scaled, aim, rcond=1e-10)[0]
    if np.linalg.norm(scaled @ found - aim) > _STRAINED * np.linalg.norm(aim):
        return None
    return np.asarray((found / scale) @ motions)


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
    normal = np.asarray(contact / max(float(np.abs(contact).max(initial=0.0)), 1e-300))
    push = np.asarray(work / max(float(np.abs(work).max()), 1e-300))
    rows = np.vstack([normal, -push[None, :]])
    if not rubs.any():
        slides = sliding_motions(normal)
        if slides.size:
            along = slides @ (slides.T @ push)
            return np.asarray(along if np.any(along) else slides[:, 0])
        motions = (_unresisted(rows, aim) for aim in (push, *_directions(len(work))))
        return next((motion for motion in motions if motion is not None), None)
    straight = sliding_motions(tangents)
    leaving = _leaving(rows @ straight, np.append(rubs, False)) if straight.size else None
    if leaving is None:
        return None
    # Of the motions away from the foundation the loads drive this one most: about an edge.
    driven = _unresisted(rows @ straight, push @ straight)
    return np.asarray(straight @ (leaving if driven is None else driven))


def _directions(count: int) -> list[FloatArray]:
    """The unit vectors (count,) of all coordinates in both directions."""
    return [sign * row for row in np.eye(count) for sign in (1.0, -1.0)]


def _best(
    aim: FloatArray, rows: FloatArray, room: float = 0.0, bounds: Sequence[Any] = (-1, 1)
) -> tuple[FloatArray, float] | None:
    """The c with ``rows c <= room`` and the largest ``aim . c``, and this number; None without."""
    # Few bodies have free motions, and the import takes a tenth of a second.
    from scipy.optimize import linprog

    found = linprog(-aim, A_ub=rows, b_ub=np.full(len(rows), room), bounds=bounds)
    return (np.asarray(found.x), float(-found.fun)) if found.status == 0 else None


def _unresisted(rows: FloatArray, aim: FloatArray) -> FloatArray | None:
    """The motion c with ``rows c <= 0`` and the largest ``aim . c``; None if all have 0."""
    found = _best(aim, rows, 1e-9)
    return None if found is None or found[1] <= 1e-3 else found[0]


def _leaving(rows: FloatArray, rubs: BoolArray) -> FloatArray | None:
    """The motion c with ``rows c <= 0`` and the least maximum of ``rows c`` over the rows that rub.

    None if the least maximum is 0.
    """
    count = rows.shape[1]
    every, bounds = np.column_stack([rows, rubs.astype(float)]), [(-1, 1)] * count + [(0, 1)]
    found = _best(np.append(np.zeros(count), 1.0), every, 1e-9, bounds)
    return None if found is None or found[1] <= 1e-3 else found[0][:count]


def sliding_motions(components: FloatArray) -> FloatArray:
    """Coefficients (f, m) of the motions without components on Gamma_C, orthonormal.

    ``components`` (k, f) are the normal, or tangential, components of f motions at nodes.
    """
    if not components.size:
        return np.eye(components.shape[1])
    # The triangle has the singular vectors of the rows, of which there may be many.
    _, sizes, directions = np.linalg.svd(np.linalg.qr(components, mode="r"))
    sizes = np.append(sizes, np.zeros(components.shape[1] - len(sizes)))
    return np.asarray(directions[sizes <= 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)].T)


def unheld_motion(
    normals: FloatArray, resistance: Callable[[FloatArray], FloatArray], work: FloatArray
) -> FloatArray | None:
    """A motion c (f,) with ``r(c) <= 0`` at all nodes and ``work . c > 0``; None if none is found.

    ``r(c) = normals c + s(c) >= normals c`` is convex and homogeneous of degree 1; ``resistance``
    gives the rows (n, f) that are its derivative, with which ``rows c = r(c)``.  Each motion is
    the best for the derivatives at those before, which are lower bounds of r.
    """
    size = max(float(np.abs(normals).max(initial=0.0)), 1e-300)
    rows: FloatArray = np.asarray(normals / size)
    push: FloatArray = np.asarray(work / max(float(np.abs(work).max(initial=0.0)), 1e-300))
    for _ in range(_CUTS):
        found = _best(push, rows)
        if found is None or found[1] < 1e-3:
            return None
        motion = found[0]
        cut = resistance(motion) / size
        if np.all(cut @ motion <= 1e-9):
            return motion
        rows = np.vstack([rows, cut])
    return None


def driven_motion(
    some: FloatArray,
    normals: FloatArray,
    work: FloatArray,
    rub: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """The motion c (f,) with ``normals c <= 0`` and the largest ``work . c - s(c)``, in a unit box.

    Sought is among the motions ``some`` (f, m).  ``s(c) = int G |c_tau|`` is convex and
    homogeneous; ``rub`` gives its derivative (f,) at a motion, with which ``rub(c) . c = s(c)``.
    Each motion is the best for the derivatives at those before, which are lower bounds of s.
    """
    push = some.T @ work
    size, count = max(float(np.abs(push).max(initial=0.0)), 1e-300), some.shape[1]
    leaving = np.pad(normals @ some, ((0, 0), (0, 1)))
    leaving /= max(float(np.abs(leaving).max(initial=0.0)), 1e-300)
    cuts: list[FloatArray] = []
    best: FloatArray = np.zeros(count)
    most = -np.inf
    for _ in range(_CUTS):
        rows = np.vstack([leaving, *(np.append(cut, -1.0) for cut in cuts)])
        found = _best(np.append(push / size, -1.0), rows, bounds=[(-1, 1)] * count + [(0, None)])
        if found is None:
            # Friction beside which the push is rounding.
            break
        motion, above = found[0][:count], found[1]
        cuts.append(np.asarray(some.T @ rub(some @ motion) / size))
        net = float((push / size - cuts[-1]) @ motion)
        if net > most:
            best, most = motion, net
        if above - most <= _NEAR * abs(above):
            break
    return np.asarray(some @ best)
