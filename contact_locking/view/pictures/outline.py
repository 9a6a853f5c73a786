"""The surfaces of foundations that pictures draw, within a box around the body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.shapes.distance import Distance, MovedDistance
from contact_locking.shapes.faceted import FacetedFoundation
from contact_locking.shapes.shape import Shape

if TYPE_CHECKING:
    from contact_locking.mesh.domain import Domain

# The box reaches beyond the body by this share of the longest edge of the body's own box.
_BESIDE = 0.25
# The points of the grid along each axis, by the dimension.
_GRID = {2: 201, 3: 61}


def outline(tool: Distance | None, travel: FloatArray, domain: Domain) -> FloatArray:
    """The facets (t, d, d) of a foundation that a force has moved by ``travel`` (d,).

    They are those of ``phi = 0`` in the box, with the foundation on their left in the plane.  A
    half space in space has none, as pictures draw the ground.
    """
    dim = domain.dim
    body = tool.body if isinstance(tool, MovedDistance) else tool
    nothing = np.empty((0, dim, dim))
    if tool is None or (dim == 3 and isinstance(body, Shape) and body.is_plane):
        return nothing
    if isinstance(body, FacetedFoundation):
        corners: FloatArray = body.facets.reshape(-1, dim).T
        corners = tool.motion.place(corners) if isinstance(tool, MovedDistance) else corners
        return corners.T.reshape(body.facets.shape) + travel
    margin = _BESIDE * float(np.ptp(domain.bounding_box, axis=0).max())
    low, high = domain.bounding_box + np.array([[-margin], [margin]])
    if domain.axisymmetric:
        low[0] = max(low[0], 0.0)
    axes = [np.linspace(a, b, _GRID[dim]) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"))
    try:
        with np.errstate(all="ignore"):
            distance = tool.gap(points.reshape(dim, -1) - travel[:, None])
    except InputError:
        # An expression needs values on Gamma_C only.
        return nothing
    values = distance.reshape(points.shape[1:])
    if dim == 2:
        import contourpy

        generator = contourpy.contour_generator(axes[0], axes[1], np.ma.masked_invalid(values.T))
        # The lines of contourpy have the larger values on their left.
        lines = [np.asarray(line)[::-1] for line in generator.lines(0.0)]
        segments = [np.stack([line[:-1], line[1:]], axis=1) for line in lines]
        found = np.concatenate([nothing, *segments])
        return np.asarray(found[np.any(found[:, 0] != found[:, 1], axis=1)])
    import pyvista

    if not (np.isfinite(values).all() and values.min() < 0.0 < values.max()):
        return nothing
    surface = pyvista.RectilinearGrid(*axes).contour([0.0], values.ravel(order="F"))
    triangles = surface.triangulate().faces.reshape(-1, 4)[:, 1:]
    return np.asarray(surface.points[triangles], dtype=float)
