"""Warnings about data and results that are possible, but that hardly anybody means."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.problem.domain import Domain

# The theory drops squares of the displacement gradient: from here on they are the larger part.
_LARGE_STRAIN = 1.0
# No loads of any body are so large.
_ABSURD = 1e30
# More than this is said as a multiple, less in per cent.
_MULTIPLE = 10.0
# What penalties leave of a violation is notable from this share on; the one that is aimed at.
_NOTABLE, _AIM = 0.1, 0.01


def about_the_gap(domain: Domain, gap: FloatArray, key: str) -> list[str]:
    """A word about a body that lies wholly inside the foundation; collective.

    ``gap`` are its owned values at the nodes of Gamma_C.  All of the body is taken to be inside
    where the least depth of Gamma_C is at least the smallest width of the body.
    """
    depth = -float(domain.comm.allreduce(np.max(gap, initial=-np.inf), op=MPI.MAX))
    low, high = domain.bounding_box()
    width = float((high - low).min())
    if depth < width:
        return []
    return [
        f"{key}: all of the body lies inside the foundation, Gamma_C at least {depth:.3g} deep; a "
        "gap is positive where there is a distance to the foundation: is its sign right, and the "
        "foundation in its place?"
    ]


def about_a_load(stress: float, stiffness: float, key: str) -> list[str]:
    """A word about a load whose largest ``stress`` is above the stiffness of the material.

    Raises InputError where it is so far above that the numbers have nothing in common.
    """
    ratio = stress / stiffness
    if ratio <= 1.0:
        return []
    text = f"it reaches {ratio:.3g} times the stiffness of the material; do their units agree?"
    if ratio > _ABSURD:
        raise InputError(text, key)
    return [f"{key}: {text}"]


def about_the_strain(largest: float) -> list[str]:
    """A word about strains for which the theory is none, however well the equations are solved."""
    if largest <= _LARGE_STRAIN:
        return []
    return [
        f"the largest strain is {largest:.3g}, and this theory is of small strains: do the units "
        "of loads, elasticity and lengths agree, and is the body held and supported as it should "
        "be?"
    ]


def about_the_overstrain(overstrain: float, n: float, young: float) -> list[str]:
    """A word about a penalised strain that exceeds its limit by a notable share of M.

    ``overstrain`` is ``|eps|/M - 1`` at its largest, ``|Z|/(2 n M)`` by (23).  A stiffer penalty
    has to bear the same Z, or what the material bears now if that is more.
    """
    if overstrain <= _NOTABLE:
        return []
    size = f"exceeds its limit by up to {100.0 * overstrain:.0f} %"
    if overstrain >= _MULTIPLE:
        size = f"is up to {1.0 + overstrain:.3g} times its limit"
    better = max(n, 0.5 * young) * overstrain / _AIM
    return [
        f"the strain {size}: penalty.n: {better:.1e} leaves about "
        f"{100.0 * _AIM:.0f} %, and .inf nothing; if that hardly helps, no displacement on this "
        "mesh within the limit can follow the prescribed ones, which .inf would report"
    ]


def about_the_penetration(
    penetration: float, displacement: float, epsilon: float, soft: float, follows_n: bool
) -> list[str]:
    """A word about a body that enters the foundation by a notable share of its displacement.

    ``penetration`` is ``max [u_nu - gap]^+ = eps p`` (25), ``displacement`` the largest ``|u|``;
    ``soft`` is the compliance of the body, its length over Young's modulus; ``follows_n`` says that
    epsilon is 1/n.
    """
    if epsilon == 0.0 or penetration <= _NOTABLE * displacement:
        return []
    share = penetration / displacement
    better = _AIM * min(epsilon / share, soft)
    key, value = ("penalty.n", 1.0 / better) if follows_n else ("penalty.epsilon", better)
    return [
        f"the body enters the foundation by {100.0 * share:.0f} % of its largest displacement: "
        f"{key}: {value:.1e} leaves about {100.0 * _AIM:.0f} %, and penalty.n: .inf "
        "without an epsilon nothing"
    ]
