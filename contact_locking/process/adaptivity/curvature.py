"""Boundary parts of a mesh file that look curved; the file does not describe their curves."""

from __future__ import annotations

import math

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.file.data import MeshData, Simplices
from contact_locking.mesh.file.topology import Facets

# Two facets of a boundary part belong to a curve if the angle between them is in this range: below
# they are parallel up to rounding, above they form an edge of the body.
_PARALLEL, _EDGE = 1e-4, math.radians(40.0)


def curved_parts(data: MeshData) -> list[str]:
    """The names of the boundary parts with neighbouring facets at a small angle, sorted."""
    return [
        name
        for name in sorted(data.facets.names)
        if _bends(data, data.facets.take(data.facets.named(name)))
    ]


def warnings(data: MeshData) -> list[str]:
    """A warning about the curved boundary parts, if there are any."""
    names = curved_parts(data)
    if not names:
        return []
    return [
        f"the boundary parts {', '.join(names)} look curved; a refinement keeps their facets "
        "straight, as a mesh file does not say what the curves are: the solutions approach that of "
        "the polygon"
    ]


def _bends(data: MeshData, part: Simplices) -> bool:
    if len(part) < 2:
        return False
    ridges = Facets(part.nodes, len(data.points))
    pairs, _ = ridges.pairs(np.flatnonzero(ridges.shared == 2))
    normals = _normals(data.points[part.nodes])
    cosines = np.abs(np.einsum("kd,kd->k", *(normals[pairs[:, i]] for i in (0, 1))))
    angles = np.arccos(np.minimum(cosines, 1.0))
    return bool(np.any((angles > _PARALLEL) & (angles < _EDGE)))


def _normals(corners: FloatArray) -> FloatArray:
    """Unit normals (k, d) of facets (k, d, d), of either sign."""
    edges = corners[:, 1:] - corners[:, :1]
    if corners.shape[1] == 2:
        normals: FloatArray = np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
    else:
        normals = np.asarray(np.cross(edges[:, 0], edges[:, 1]), dtype=float)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])
