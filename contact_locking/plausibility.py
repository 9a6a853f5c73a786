"""Warnings about data and results that are possible, but that hardly anybody means."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from contact_locking.domain import Domain
from contact_locking.errors import InputError

FloatArray = npt.NDArray[np.float64]

# The theory drops squares of the displacement gradient: from here on they are the larger part.
_LARGE_STRAIN = 1.0
# No loads of any body are so large.
_ABSURD = 1e30
# More than this is said as a multiple, less in per cent.
_MULTIPLE = 10.0


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


def about_the_overstrain(overstrain: float) -> str:
    """``|eps|/M - 1`` in words."""
    if overstrain < _MULTIPLE:
        return f"the strain exceeds its limit by up to {100.0 * overstrain:.0f} %"
    return f"the strain is up to {1.0 + overstrain:.3g} times its limit"
