"""Small pictures of meshes: their edges, and the cells that were marked."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.plotting import style
from contact_locking.results.adapted_meshes import AdaptedMesh

# Towards the eye, for the surface of a body in 3D: from the front and from below, where contact is.
_TO_EYE = np.array([0.45, -0.8, -0.4])
_UP = np.array([0.0, 0.0, 1.0])
# Edges of the finest meshes would cover their cells.
_WIDEST, _CELLS = 0.5, 600.0


def draw_mesh(axes: Axes, mesh: AdaptedMesh) -> None:
    """Draw the edges of a mesh; marked cells are coloured.

    The lines become an image, because a picture of all lines would be as large as the mesh.
    """
    x, triangles, marked = mesh.x, mesh.triangles, mesh.marked
    if mesh.dim == 3:
        x, order = _seen(x, triangles)
        triangles, marked = triangles[order], marked[order]
    width = min(_WIDEST, _WIDEST * (_CELLS / max(len(triangles), 1)) ** 0.5)
    axes.add_collection(
        PolyCollection(
            list(x[triangles]),
            facecolors=np.where(marked, style.ORANGE, "white").tolist(),
            edgecolors=style.BLACK,
            linewidths=width,
            rasterized=True,
        )
    )
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()


def _seen(x: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """The points (v, 2) in the plane of the picture, and the triangles from back to front."""
    eye = _TO_EYE / np.linalg.norm(_TO_EYE)
    right = np.cross(_UP, eye)
    right /= np.linalg.norm(right)
    plane: FloatArray = np.column_stack([x @ right, x @ np.cross(eye, right)])
    depth = (x @ eye)[triangles].mean(axis=1)
    return plane, np.asarray(np.argsort(depth), dtype=np.int64)
