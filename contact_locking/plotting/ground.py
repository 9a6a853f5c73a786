"""The surface of the rigid foundation as the pictures draw it."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.plotting.snapshot import ContactMap

# Reach of the drawn foundation beyond Gamma_C as a share of the body's size.
_REACH = 0.12
# A tool that reaches farther beyond the body, as a share of its size, and one of more facets, is
# drawn as far as Gamma_C sees it.
_FARTHEST, _MOST_FACETS = 1.5, 20_000
# Points are in a plane if their distance from the plane is below this share of their extent.
_PLANE = 1e-6


def touched(contact: ContactMap, factor: float) -> FloatArray:
    """The points (k, d) of the foundation below those of Gamma_C, at ``factor`` times the gap."""
    points = contact.points
    return points.x + factor * points.gap[:, None] * points.normal


def drawn_tool(outline: FloatArray, x: FloatArray) -> FloatArray:
    """The facets (t, d, d) of a tool if all of it is drawn beside the body x (v, d), else none."""
    low, high = x.min(axis=0), x.max(axis=0)
    reach = _FARTHEST * float((high - low).max())
    beside = np.all(outline >= low - reach) and np.all(outline <= high + reach)
    return outline if beside and len(outline) <= _MOST_FACETS else outline[:0]


def tool(contact: ContactMap, factor: float) -> FloatArray:
    """The facets (t, d, d) of the tool of one contact, if the picture has a true scale."""
    (facets,) = contact.tools or (np.empty((0, 0, 0)),)
    return facets if factor == 1.0 else facets[:0]


def foundation(contact: ContactMap, factor: float, size: float) -> FloatArray:
    """The facets of a tool, or the surface at Gamma_C + gap nu (m, 3 or 4, 3).

    The surface is one rectangle if it is plane, else it has the facets of Gamma_C.
    """
    if len(facets := tool(contact, factor)):
        return facets
    surface = touched(contact, factor)
    centre = surface.mean(axis=0)
    _, spread, basis = np.linalg.svd(surface - centre, full_matrices=False)
    if spread[2] > _PLANE * spread[0]:
        return surface[contact.facets]
    # Along the axes of coordinates where the plane allows it.
    first = np.eye(3)[np.argmin(np.abs(basis[2]))]
    first = first - (first @ basis[2]) * basis[2]
    first /= np.linalg.norm(first)
    frame = np.array([first, np.cross(basis[2], first)])
    flat = (surface - centre) @ frame.T
    low, high = flat.min(axis=0) - _REACH * size, flat.max(axis=0) + _REACH * size
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return (centre + corners @ frame)[None]
