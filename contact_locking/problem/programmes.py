"""The linear programmes for rigid motions that contact and friction do not stop.

A motion is given by its coefficients (f,) of the f motions that the conditions leave free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray

# The most rounds of the search for a motion that friction does not stop.  In 2D a few suffice.
_CUTS = 40
# The share of the net work of loads and friction by which a slide may miss the most.
_NEAR = 1e-4
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
    return np.asarray(directions[sizes <= 1e-9 * _size_of(sizes)].T)


def unheld_motion(
    normals: FloatArray, resistance: Callable[[FloatArray], FloatArray], work: FloatArray
) -> FloatArray | None:
    """A motion c (f,) with ``r(c) <= 0`` at all nodes and ``work . c > 0``; None if none is found.

    ``r(c) = normals c + s(c) >= normals c`` is convex and homogeneous of degree 1; ``resistance``
    gives the rows (n, f) that are its derivative, with which ``rows c = r(c)``.  Each motion is
    the best for the derivatives at those before, which are lower bounds of r.
    """
    size = _size_of(normals)
    rows, push = _scaled(normals), _scaled(work)
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
    size, count = _size_of(push), some.shape[1]
    leaving = np.pad(normals @ some, ((0, 0), (0, 1)))
    leaving /= _size_of(leaving)
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
