"""What a mesh may miss: loads and data narrower than a cell, and tools between its nodes.

Each case is solved right, by sums of this module, or the program says what the mesh misses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .case import Case, Random, Study, Truth, family, study
from .elements import Array, Body, value
from .judge import FORCE, Found, Judge
from .observed import Moment

# The forces of a narrow load may be off by this share in the norm of K^-1.
_LOAD = 0.05
# Data may change by this factor within a cell, and a tool may enter between the nodes by this share
# of its indentation, without a word.
_FACTOR, _ENTRY = 1.7, 0.15
# Nodes touch within this share of the radius, and see a foundation that turns by less between them.
_TOUCH, _TURN = 0.02, 0.7
# Points of an edge of a cell or facet.
_POINTS = 32
# Words of the program about tools, loads and data.
_TOOL_WORDS = ("between the nodes", "that the nodes miss")
_LOAD_WORDS = ("changes too sharply", "its resultant is uncertain", "zero at all quadrature points")
_DATA_WORDS = ("where it is evaluated", "changes from")


def _mesh(random: Random, h: float) -> Study:
    return random.block([2.0, 1.0], h)


@family
def between_nodes(random: Random) -> Case:
    """A roller of about the size of a facet, pressed into a clamped block wherever it is."""
    h = random.pick([0.2, 0.25, 0.34])
    radius = h * random.decades(-0.6, 0.4)
    depth = min(radius, h) * random.between(0.01, 0.4)
    centre = [random.between(0.3, 1.7), 1.0 + radius - depth]
    data = study(
        _mesh(random, h),
        {"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
        gap={"cylinder": {"centre": centre, "radius": radius}},
        on="top",
        friction=random.pick([0.0, 0.3]),
        smoothing=random.kernel(2.5 * h),
    )
    return Case(data, Truth(told=_TOOL_WORDS))


@family
def narrow(random: Random) -> Case:
    """A pressure, a limit or a coefficient that changes within a cell, down to thin spots."""
    h = random.pick([0.2, 0.25, 0.34])
    centre, half = random.between(0.2, 1.8), h * random.decades(-2.5, 0.3)
    inside = f"abs(x - {centre}) < {half}"
    what = random.pick(["load", "limit", "friction"])
    size = random.decades(-4.0, -2.0)
    pressure = random.between(0.1, 1.0) * size / min(half, 1.0)
    loads: Study = {"displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    limit: float | str = 1.0
    friction: float | str = random.pick([0.0, 0.3])
    told: tuple[str, ...] = _DATA_WORDS
    band = None
    if what == "load":
        loads["tractions"] = [{"on": "top", "value": [0.0, f"-{pressure} if {inside} else 0"]}]
        told, band = _LOAD_WORDS, (centre, half, pressure)
    else:
        loads["tractions"] = [{"on": "top", "value": [0.3 * size, -size]}]
        # Thinner than this a spot may fall between all points that are looked at.
        half = max(half, 0.02 * h)
        inside = f"abs(x - {centre}) < {half}"
        if what == "limit":
            limit = f"{size} if {inside} else {5.0 * size}"
        else:
            friction = f"0.6 if {inside} else 0.1"
    data = study(
        _mesh(random, h), loads, limit=limit, friction=friction, smoothing=random.kernel(2.5 * h)
    )
    return Case(data, Truth(told=told, band=band))


def load_of_band(truth: Truth, body: Body) -> Array | None:
    """The exact nodal forces (k, 2) of a pressure on a band ``|x - c| < w`` on top, if any."""
    if truth.band is None:
        return None
    centre, half, pressure = truth.band
    x = body.mesh.x
    load = np.zeros_like(x)
    for first, second in body.facets("top"):
        a, b = x[first, 0], x[second, 0]
        low, high = (np.clip(centre + side * half, min(a, b), max(a, b)) for side in (-1, 1))
        share = (0.5 * (low + high) - a) / (b - a)
        for node, part in ((first, 1.0 - share), (second, share)):
            load[node, 1] -= pressure * (high - low) * part
    return load


def complaint(
    truth: Truth, judge: Judge, moment: Moment, warnings: Sequence[str], found: Found
) -> str:
    """What the mesh misses without a word of the program; "" if nothing.

    Takes the violation of equilibrium by a narrow load out of ``found``.
    """
    if not truth.told:
        return ""
    said = " ".join(warnings)
    is_told = any(words in said for words in truth.told)
    wrong = []
    if truth.band is not None:
        off = FORCE * found.pop("equilibrium")
        for name in ("balance of forces", "balance of moments", "reported reactions"):
            found.pop(name, None)
        if off > _LOAD:
            wrong.append(f"the narrow load is off by {off:.2g}")
    body, x = judge.body, judge.mesh.x
    limits = value(judge.study["material"]["locking_limit"], _inside(x[body.cells]))
    wrong += _varies("M", limits, len(body.cells))
    for contact in judge.contacts:
        facets = contact.nodes[contact.facets]
        if contact.friction["coefficient"] != 0.0:
            places = _inside(x[facets])
            mu = value(contact.friction["coefficient"], places, s=np.zeros(len(places)))
            wrong += _varies("mu", mu, len(facets))
        tool = contact.section.get("foundation", {}).get("cylinder")
        if tool is not None:
            u = moment.u
            entry = _entry(x[facets], u[facets], np.array(tool["centre"]), tool["radius"])
            if entry > _ENTRY:
                wrong.append(f"the tool enters between the nodes by {entry:.2g} of its indentation")
    return "" if is_told else "; ".join(f"without a word: {text}" for text in wrong)


def _inside(corners: Array) -> Array:
    """Points (k * q, d) inside of simplices with corners (k, c, d): cells of 2D, or edges."""
    lattice = (np.arange(_POINTS) + 0.5) / _POINTS
    if corners.shape[1] == 2:
        shares = np.stack([1.0 - lattice, lattice], axis=1)
    else:
        a, b = (part.ravel() for part in np.meshgrid(lattice, lattice))
        shares = np.stack([a, b, 1.0 - a - b], axis=1)[a + b < 1.0]
    return np.einsum("qc,kcd->kqd", shares, corners).reshape(-1, corners.shape[2])


def _varies(name: str, values: Array, count: int) -> list[str]:
    """Data that change much within a simplex by a jump: more than along a slope over the body."""
    inside = values.reshape(count, -1)
    low, high = inside.min(axis=1), inside.max(axis=1)
    factors = high / np.maximum(low, 1e-300) if np.isfinite(low).all() else np.ones(count)
    worst = int(np.argmax(factors))
    if not factors[worst] > _FACTOR:
        return []
    return [f"{name} goes from {low[worst]:.2g} to {high[worst]:.2g} inside of a cell or facet"]


def _entry(x: Array, u: Array, centre: Array, radius: float) -> float:
    """The deepest entry of a disc between the nodes of edges (k, 2, d), over its indentation.

    Where both nodes touch the disc and see it turn by little, the edge is a chord of what is known.
    """
    share = np.linspace(0.0, 1.0, _POINTS + 1)[:, None]

    def depth(points: Array) -> Array:
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
