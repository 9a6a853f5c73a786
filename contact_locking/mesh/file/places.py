"""The words of messages for nodes, elements and points of a mesh file."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.mesh.cell_kind import CellKind
from contact_locking.mesh.file.data import MeshData, MeshElements

#: The way out for a mesh of several kinds of cells.
ONE_KIND = (
    "a body needs cells of one kind: in Gmsh leave out Recombine and mesh again for simplices, or "
    "recombine every surface and volume (Mesh.RecombineAll with Mesh.SubdivisionAlgorithm = 1 for "
    "quadrilaterals, 2 for hexahedra)"
)


def of_facets(kind: CellKind) -> str:
    """The facets of a kind of cells in words, without an article."""
    return "line" if kind.dim == 2 else kind.facet.name


def at(point: FloatArray) -> str:
    """The coordinates of a point in brackets."""
    # Adding zero turns -0 into 0.
    return "(" + ", ".join(f"{x + 0.0:.6g}" for x in point) + ")"


def node(mesh: MeshData, index: int) -> str:
    """A node by its number, with its coordinates."""
    return f"node {mesh.numbers[index]} at {at(mesh.points[index])}"


def listed(numbers: IntArray) -> str:
    """Two numbers or more, with an "and" before the last."""
    *most, last = map(str, numbers)
    return f"{', '.join(most)} and {last}"


def nodes(mesh: MeshData, indices: IntArray) -> str:
    """Several nodes by their numbers."""
    return f"nodes {listed(mesh.numbers[indices])}"


def cell(mesh: MeshData, index: int) -> str:
    """A cell by its number, with its centre."""
    return f"{mesh.kind.name} {mesh.cells.numbers[index]} at {_centre(mesh, mesh.cells, index)}"


def facet(mesh: MeshData, index: int) -> str:
    """A facet of a group by its number, with its centre."""
    where = _centre(mesh, mesh.facets, index)
    return f"{of_facets(mesh.kind)} {mesh.facets.numbers[index]} at {where}"


def _centre(mesh: MeshData, elements: MeshElements, index: int) -> str:
    return at(np.mean(mesh.points[elements.nodes[index]], axis=0))


def more(count: int) -> str:
    """The number of further cases, for a message that names one; empty without any."""
    return f", and {count - 1} more" if count > 1 else ""
