"""Findings: data and results that are possible but probably not intended, with their texts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import maximum

#: The texts by code.  A text about a key begins with it.
TEXTS = {
    "gap.inside": "all of the body lies inside the foundation, Gamma_C at least {depth:.3g} deep; "
    "a gap is positive where there is a distance to the foundation: is its sign right, and the "
    "foundation in its place?",
    "foundation.overlap": "it overlaps the body at rest by up to {depth:.3g}, along normals that "
    "are up to {turn:.2g} rad off their mean, and friction does not know of the way on which it "
    "came: take {key}.motion from where it touches, and steps",
    "foundation.far": "the body is {extent:.3g} long, and the foundation is {distance:.3g} away "
    "from Gamma_C; does the foundation stand in its place, in the units of the mesh?",
    "foundation.size": "it is {size:.3g} long, and the body {extent:.3g}; are its units those of "
    "the mesh?",
    "load.large": "it reaches {ratio:.3g} times the stiffness of the material; do their units "
    "agree?",
    "strain.large": "the largest strain is {strain:.3g}, and this theory is of small strains: "
    "stresses there are uncertain by about {per_cent:.0f} %",
    "strain.absurd": "the largest strain is {strain:.3g}, and this theory is of small strains: do "
    "the units of loads, elasticity and lengths agree, and do displacement conditions or contact "
    "hold the body?",
    "rotation.large": "the body turns by {angle:.2g} rad near ({place}), and this theory is of "
    "small rotations: it neglects strains of {neglected:.2g}, half of the square, beside the "
    "largest strain of {strain:.2g}; take a smaller load, or a program for large rotations",
    "limit.exceeded": "the strain exceeds its limit by up to {per_cent:.0f} %: penalty.n: "
    "{n:.1e} leaves about {aim:.0f} %, and .inf nothing; if that hardly helps, no displacement on "
    "this mesh within the limit can follow the prescribed ones, which .inf would report",
    "limit.exceeded_far": "the strain is up to {times:.3g} times its limit: penalty.n: {n:.1e} "
    "leaves about {aim:.0f} %, and .inf nothing; if that hardly helps, no displacement on this "
    "mesh within the limit can follow the prescribed ones, which .inf would report",
    "limit.between_points": "the strain is up to {per_cent:.0f} % of its limit between the points "
    "of a cell where the element keeps the limit; a finer mesh brings this nearer to 100 %",
    "contact.held_nodes": "the foundation enters the body by {depth:.3g} at nodes that "
    "loads.displacements holds, where no contact acts; end contact.on, or the foundation, before "
    "the part that is held",
    "contact.between_nodes": "between the nodes near ({place}) the foundation enters the body by "
    "{depth:.3g}, {per_cent:.0f} % of its indentation; the conditions of contact hold at the nodes "
    "alone: take smaller cells there, or a rounder foundation",
    "contact.uncovered": "the boundary outside of {key}.on enters the foundation by {depth:.3g} "
    "near ({place}), where no contact acts; add the boundary part there to {key}.on, unless the "
    "foundation ends before",
    "contact.normals": "the normals of the bodies where they press are {turn:.2g} rad off those "
    "of the undeformed mesh, which counts beside the friction coefficient {friction:.3g}; leave "
    "out pair: once",
    "contact.sliding": "the bodies slide by {slid:.3g} along each other, {facets:.2g} facets of "
    "against, and the points that face each other are those of the undeformed mesh: leave out "
    "pair: once",
    "contact.penetration": "the body enters the foundation by {per_cent:.0f} % of its largest "
    "displacement: {parameter}: {value:.1e} leaves about {aim:.0f} %, and penalty.n: .inf without "
    "an epsilon nothing",
}
# No body can bear loads of this multiple of its stiffness.
_ABSURD = 1e30
# An overlap below this share of the extent of the body is rounding.
_TOUCHING = 1e-9
# A foundation is not so many times as long or as short as the body, but in other units.
_LARGE_RATIO = 200.0
# Normals count that turn by this share of the friction coefficient.
_NOTABLE = 0.1


class Finding(str):
    """A finding in words, with its code, the key that it is about and its numbers.

    Parameters
    ----------
    code
        a key of `TEXTS`
    key
        the key of the study file, or the argument of a script; empty for the whole body
    numbers
        what the text tells
    """

    code: str
    key: str
    numbers: Mapping[str, Any]

    def __new__(cls, code: str, key: str = "", **numbers: Any) -> Finding:
        text = TEXTS[code].format(key=key, **numbers)
        finding = super().__new__(cls, f"{key}: {text}" if key else text)
        vars(finding).update(code=code, key=key, numbers=numbers)
        return finding

    def __getnewargs_ex__(self) -> tuple[tuple[str, str], dict[str, Any]]:
        return (self.code, self.key), dict(self.numbers)


def about_the_gap(domain: Domain, gap: FloatArray, key: str) -> list[str]:
    """Whether the body lies wholly inside the foundation; collective.

    ``gap`` (k,) are the values at the owned nodes of Gamma_C.  The whole body counts as inside if
    the least depth of Gamma_C is at least the smallest width of the body.
    """
    depth = -maximum(domain.comm, gap, -np.inf)
    low, high = domain.bounding_box
    is_inside = depth >= float((high - low).min())
    return [Finding("gap.inside", key, depth=depth)] if is_inside else []


def about_an_overlap_at_rest(
    domain: Domain,
    depths: FloatArray,
    normals: FloatArray,
    outward: FloatArray,
    mu: FloatArray,
    key: str,
) -> list[str]:
    """Whether a curved foundation with friction rests at its end; collective.

    ``depths`` (k,) are how far nodes of Gamma_C are inside of the foundation at rest, with the
    normals of the foundation and of the body (k, d) and the friction coefficients ``mu`` (k,).
    Where depths and normals differ the foundation has come with a part of its way along the body,
    which would be slip.  A press fit on a shaft has the normals of the body and one depth.
    """
    nearly = _TOUCHING * domain.extent
    inside = [values[depths > nearly] for values in (depths, normals, outward, mu)]
    depths, normals, outward, mu = (np.concatenate(domain.comm.allgather(part)) for part in inside)
    if not len(depths):
        return []
    turn = float(np.linalg.norm(normals - normals.mean(axis=0), axis=1).max())
    tilt = float(np.linalg.norm(normals - outward, axis=1).max())
    least = _NOTABLE * min(float(mu.max()), 1.0)
    is_even = tilt <= least and depths.min() > 0.5 * depths.max()
    if least == 0.0 or turn <= least or is_even:
        return []
    return [Finding("foundation.overlap", key, depth=depths.max(), turn=turn)]


def about_the_distance(domain: Domain, gap: FloatArray, key: str) -> list[str]:
    """Whether a foundation is farther away than the body is long; collective."""
    distance, extent = -maximum(domain.comm, -gap, -np.inf), domain.extent
    is_far = distance > extent
    return [Finding("foundation.far", key, distance=distance, extent=extent)] if is_far else []


def about_the_size(domain: Domain, size: float, key: str) -> list[str]:
    """Whether a foundation has the wrong units, as m for mm; collective."""
    if 1.0 / _LARGE_RATIO < size / domain.extent < _LARGE_RATIO:
        return []
    return [Finding("foundation.size", key, size=size, extent=domain.extent)]


def about_a_load(stress: float, stiffness: float, key: str) -> list[str]:
    """Whether the largest ``stress`` of a load is above the stiffness of the material.

    Raises InputError for a load that no body can bear.
    """
    ratio = stress / stiffness
    if ratio > _ABSURD:
        raise InputError(TEXTS["load.large"].format(ratio=ratio), key)
    return [Finding("load.large", key, ratio=ratio)] if ratio > 1.0 else []
