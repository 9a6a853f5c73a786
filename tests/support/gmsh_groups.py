"""What Gmsh has meshed: geometries by name, the simplices of groups, and their measures."""

import math
from typing import Any

import numpy as np

from contact_locking.meshes import BUILDERS, Geometry

Array = np.ndarray[Any, Any]
Groups = dict[str, Array]


def make(name: str, **given: Any) -> Geometry:
    """The geometry of that name, with these parameters."""
    return BUILDERS[name](**given)


def read(model: Any, dim: int) -> tuple[Array, Groups, Groups]:
    """Points, and the corner numbers of the simplices of every group of cells and of facets."""
    tags, points, _ = model.mesh.getNodes()
    number = np.full(int(tags.max()) + 1, -1)
    number[tags] = np.arange(len(tags))
    both: list[Groups] = []
    for d in (dim, dim - 1):
        groups: Groups = {}
        for _, group in model.getPhysicalGroups(d):
            corners = [
                number[nodes.astype(int)].reshape(-1, d + 1)
                for entity in model.getEntitiesForPhysicalGroup(d, group)
                for nodes in model.mesh.getElements(d, entity)[2]
            ]
            groups[model.getPhysicalName(d, group)] = np.concatenate(corners)
        both.append(groups)
    return points.reshape(-1, 3), both[0], both[1]


def measures(points: Array, simplices: Array) -> Array:
    """sqrt(det(E E^T)) / k! of every simplex with the edge vectors E = x_i - x_0, i = 1 .. k."""
    edges = points[simplices[:, 1:]] - points[simplices[:, :1]]
    gram = np.linalg.det(edges @ edges.transpose(0, 2, 1))
    return np.sqrt(gram) / math.factorial(edges.shape[1])
