"""What a mesh may miss: loads and data narrower than a cell, and tools between its nodes.

Each case is solved right, by sums of this module, or the program says what the mesh misses.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.results.solution import StudySolution

from .case import Truth
from .discrete import Discrete, State, at
from .judge import FORCE, Found

# The forces of a narrow load may be off by this share in the norm of K^-1.
_LOAD = 0.05
# Data may change by this factor within a cell, and a tool may enter between the nodes by this share
# of its indentation, without a word.
_FACTOR, _ENTRY = 1.7, 0.15
# Nodes touch within this share of the radius, and see a foundation that turns by less between them.
_TOUCH, _TURN = 0.02, 0.7
# Points of an edge of a cell or facet.
_POINTS = 32


def with_band(truth: Truth, discrete: Discrete) -> Discrete:
    """The problem with the exact nodal forces of a pressure on a band ``|x - c| < w`` on top."""
    if truth.band is None:
        return discrete
    centre, half, pressure = truth.band
    load, x = discrete.load.reshape(-1, 2).copy(), discrete.geometry.x
    load[:] = 0.0
    for first, second in discrete.geometry.facets(("top",)):
        a, b = x[first, 0], x[second, 0]
        low, high = (np.clip(centre + side * half, min(a, b), max(a, b)) for side in (-1, 1))
        share = (0.5 * (low + high) - a) / (b - a)
        for node, part in ((first, 1.0 - share), (second, share)):
            load[node, 1] -= pressure * (high - low) * part
    return dataclasses.replace(discrete, load=load.ravel(), load_size=np.abs(load).ravel())


def complaint(
    truth: Truth, discrete: Discrete, state: State, solution: StudySolution, found: Found
) -> str:
    """What the mesh misses without a word of the program; "" if nothing.

    Takes the violation of equilibrium by a narrow load out of ``found``.
    """
    if not truth.told:
        return ""
    said = " ".join(solution.summary["warnings"])
    is_told = any(words in said for words in truth.told)
    wrong = []
    if truth.band is not None:
        off = FORCE * found.pop("equilibrium")
        if off > _LOAD:
            wrong.append(f"the narrow load is off by {off:.2g}")
    given = solution.parameters
    x, dim = discrete.geometry.x, discrete.dim
    limits = at(given.material.locking_limit, _inside(x[discrete.geometry.cells]))
    wrong += _varies("M", limits, len(discrete.geometry.cells))
    for contact in given.contacts:
        facets = discrete.geometry.facets(contact.on)
        if contact.friction is not None and not contact.friction.is_zero:
            places = _inside(x[facets])
            mu = at(contact.friction.coefficient, places, s=np.zeros(len(places)))
            wrong += _varies("mu", mu, len(facets))
        if contact.foundation is not None and contact.foundation.cylinder is not None:
            body, u = contact.foundation.cylinder, state.u.reshape(-1, dim)
            entry = _entry(x[facets], u[facets], np.array(body.centre), body.radius)
            if entry > _ENTRY:
                wrong.append(f"the tool enters between the nodes by {entry:.2g} of its indentation")
    return "" if is_told else "; ".join(f"without a word: {text}" for text in wrong)


def _inside(corners: FloatArray) -> FloatArray:
    """Points (k * q, d) inside of simplices with corners (k, c, d): cells of 2D, or edges."""
    lattice = (np.arange(_POINTS) + 0.5) / _POINTS
    if corners.shape[1] == 2:
        shares = np.stack([1.0 - lattice, lattice], axis=1)
    else:
        a, b = (part.ravel() for part in np.meshgrid(lattice, lattice))
        shares = np.stack([a, b, 1.0 - a - b], axis=1)[a + b < 1.0]
    return np.einsum("qc,kcd->kqd", shares, corners).reshape(-1, corners.shape[2])


def _varies(name: str, values: FloatArray, count: int) -> list[str]:
    """Data that change much within a simplex by a jump: more than along a slope over the body."""
    inside = values.reshape(count, -1)
    low, high = inside.min(axis=1), inside.max(axis=1)
    factors = high / np.maximum(low, 1e-300) if np.isfinite(low).all() else np.ones(count)
    worst = int(np.argmax(factors))
    if not factors[worst] > _FACTOR:
        return []
    return [f"{name} goes from {low[worst]:.2g} to {high[worst]:.2g} inside of a cell or facet"]


def _entry(x: FloatArray, u: FloatArray, centre: FloatArray, radius: float) -> float:
    """The deepest entry of a disc between the nodes of edges (k, 2, d), over its indentation.

    Where both nodes touch the disc and see it turn by little, the edge is a chord of what is known.
    """
    share = np.linspace(0.0, 1.0, _POINTS + 1)[:, None]

    def depth(points: FloatArray) -> FloatArray:
        edges = points[:, None, 0] * (1.0 - share) + points[:, None, 1] * share
        return np.asarray(radius - np.linalg.norm(edges - centre, axis=2))

    moved = depth(x + u)
    ends = np.maximum(moved[:, [0, -1]], 0.0)
    beyond = moved - (ends[:, :1] * (1.0 - share.T) + ends[:, 1:] * share.T)
    middle = np.linalg.norm((x + u).mean(axis=1) - centre, axis=1)
    half = 0.5 * np.linalg.norm(x[:, 1] + u[:, 1] - x[:, 0] - u[:, 0], axis=1)
    touches = np.all(moved[:, [0, -1]] > -_TOUCH * radius, axis=1)
    beyond[touches & (2.0 * np.arctan2(half, middle) < _TURN)] = 0.0
    indentation = float(depth(x).max(initial=0.0))
    return float(beyond.max()) / indentation if indentation > 0.0 else 0.0
