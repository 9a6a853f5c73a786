"""The words of messages for nodes, elements and points of a mesh file."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.mesh.file.data import MeshData, Simplices

CELL = {2: "triangle", 3: "tetrahedron"}
FACET = {2: "line", 3: "triangle"}


def at(point: FloatArray) -> str:
    """The coordinates of a point in brackets."""
    # Adding zero turns -0 into 0.
    return "(" + ", ".join(f"{x + 0.0:.6g}" for x in point) + ")"


def node(mesh: MeshData, index: int) -> str:
    """A node by its number, with its coordinates."""
    return f"node {mesh.numbers[index]} at {at(mesh.points[index])}"


def nodes(mesh: MeshData, indices: IntArray) -> str:
    """Several nodes by their numbers."""
    *most, last = [str(mesh.numbers[i]) for i in indices]
    return f"nodes {', '.join(most)} and {last}"


def cell(mesh: MeshData, index: int) -> str:
    """A cell by its number, with its centre."""
    return f"{CELL[mesh.dim]} {mesh.cells.numbers[index]} at {centre(mesh, mesh.cells, index)}"


def facet(mesh: MeshData, index: int) -> str:
    """A facet of a group by its number, with its centre."""
    return f"{FACET[mesh.dim]} {mesh.facets.numbers[index]} at {centre(mesh, mesh.facets, index)}"


def centre(mesh: MeshData, simplices: Simplices, index: int) -> str:
    """The centre of a simplex."""
    return at(np.mean(mesh.points[simplices.nodes[index]], axis=0))


def more(count: int) -> str:
    """The number of further cases, for a message that names one; empty without any."""
    return f", and {count - 1} more" if count > 1 else ""
