"""A mesh as NumPy arrays: kinds of cells, points with cells and facets, a file of these arrays.

The kinds are simplices, and boxes, which are quadrilaterals and hexahedra.  Corners are numbered as
in DOLFINx: those of a box as the numbers of its corners in binary digits, the first digit the
coordinate along the first axis.  basix is imported where an element is made, as study files are
read without DOLFINx.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding


@dataclass(frozen=True)
class CellKind:
    """A kind of cells or facets with straight edges.

    ``name`` is the name of the kind in DOLFINx, and ``plural`` that of several cells in words.
    ``gmsh`` is its number in Gmsh, and ``gmsh_order`` (c,) gives for each corner its place there.
    ``facets`` (f, n) are the corners of each facet.  ``simplices`` (p, dim + 1) divide the cell,
    and ``beside`` (s, dim + 1) are the simplices of each corner with its neighbours: their volumes
    are the Jacobian at the corners, and have one sign in a convex cell.
    """

    name: str
    plural: str
    dim: int
    gmsh: int
    gmsh_order: tuple[int, ...]
    facets: tuple[tuple[int, ...], ...]
    simplices: tuple[tuple[int, ...], ...]
    beside: tuple[tuple[int, ...], ...]

    @property
    def corners(self) -> int:
        return len(self.gmsh_order)

    @property
    def is_simplex(self) -> bool:
        """Whether the cell is a simplex, in which affine fields have constant gradients."""
        return self.corners == self.dim + 1

    @property
    def measure(self) -> float:
        """The measure of the reference cell."""
        return 1.0 / math.factorial(self.dim) if self.is_simplex else 1.0

    @property
    def facet(self) -> CellKind:
        return KINDS[self.dim - 1, len(self.facets[0])]

    @property
    def facet_word(self) -> str:
        """The kind of the facets of a cell in words."""
        return "line" if self.dim == 2 else self.facet.name

    @cached_property
    def opposite(self) -> IntArray:
        """(f,) a corner that is not on each facet; corner i for facet i of a simplex."""
        every = range(self.corners)
        return np.array([min(set(every) - set(facet)) for facet in self.facets])

    def facets_of(self, cells: IntArray) -> IntArray:
        """The facets (f k, n) of cells (k, c), facet after facet, as corners."""
        return np.concatenate([cells[:, list(facet)] for facet in self.facets])

    def split(self, cells: IntArray | IndexArray) -> IntArray:
        """The simplices (k p, dim + 1) of cells (k, c), cell after cell."""
        pieces = cells[:, np.array(self.simplices)].reshape(-1, self.dim + 1)
        return np.asarray(pieces, dtype=np.int64)

    def basis(self, points: FloatArray) -> FloatArray:
        """The values (q, c) of the functions of degree 1 of the corners at points (q, dim)."""
        if self.is_simplex:
            return np.column_stack([1.0 - points.sum(axis=1), points])
        values = np.ones((len(points), self.corners))
        for axis in range(self.dim):
            far = (np.arange(self.corners) >> axis & 1).astype(bool)
            values *= np.where(far, points[:, axis : axis + 1], 1.0 - points[:, axis : axis + 1])
        return values

    def room(self, points: FloatArray) -> FloatArray:
        """(q,) the least distance of points (q, dim) to the sides of the reference cell.

        It is negative outside.
        """
        ends = 1.0 - (points.sum(axis=1, keepdims=True) if self.is_simplex else points)
        return np.asarray(np.minimum(points.min(axis=1), ends.min(axis=1)))

    @property
    def places(self) -> FloatArray:
        """The corners (c, dim) of the reference cell."""
        if self.is_simplex:
            return np.vstack([np.zeros(self.dim), np.eye(self.dim)])
        return np.array([[i >> axis & 1 for axis in range(self.dim)] for i in range(self.corners)])


INTERVAL = CellKind("interval", "lines", 1, 1, (0, 1), ((0,), (1,)), ((0, 1),), ((0, 1),))
TRIANGLE = CellKind(
    *("triangle", "triangles", 2, 2, (0, 1, 2)),
    facets=((1, 2), (0, 2), (0, 1)),
    simplices=((0, 1, 2),),
    beside=((0, 1, 2),),
)
QUADRILATERAL = CellKind(
    *("quadrilateral", "quadrilaterals", 2, 3, (0, 1, 3, 2)),
    facets=((0, 1), (0, 2), (1, 3), (2, 3)),
    simplices=((0, 1, 2), (3, 2, 1)),
    beside=((0, 1, 2), (1, 3, 0), (2, 0, 3), (3, 2, 1)),
)
TETRAHEDRON = CellKind(
    *("tetrahedron", "tetrahedra", 3, 4, (0, 1, 2, 3)),
    facets=((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)),
    simplices=((0, 1, 2, 3),),
    beside=((0, 1, 2, 3),),
)
HEXAHEDRON = CellKind(
    *("hexahedron", "hexahedra", 3, 5, (0, 1, 3, 2, 4, 5, 7, 6)),
    facets=((0, 1, 2, 3), (0, 1, 4, 5), (0, 2, 4, 6), (1, 3, 5, 7), (2, 3, 6, 7), (4, 5, 6, 7)),
    # The six simplices along the diagonal from corner 0 to corner 7.
    simplices=(
        *((0, 1, 3, 7), (0, 5, 1, 7), (0, 3, 2, 7)),
        *((0, 2, 6, 7), (0, 4, 5, 7), (0, 6, 4, 7)),
    ),
    beside=(
        *((0, 1, 2, 4), (1, 3, 0, 5), (2, 0, 3, 6), (3, 2, 1, 7)),
        *((4, 6, 5, 0), (5, 4, 7, 1), (6, 7, 4, 2), (7, 5, 6, 3)),
    ),
)

#: The kinds by dimension and number of corners.
KINDS = {
    (kind.dim, kind.corners): kind
    for kind in (INTERVAL, TRIANGLE, QUADRILATERAL, TETRAHEDRON, HEXAHEDRON)
}
#: The kinds of cells of bodies by their names in DOLFINx.
NAMED = {kind.name: kind for kind in KINDS.values() if kind.dim > 1}


def facet_normals(corners: FloatArray) -> FloatArray:
    """Normals (m, d) of facets (m, c, d), whose lengths are the measures of the facets.

    They point to the side that the order of the corners gives.  That of a quadrilateral is the mean
    over the facet, which is the measure of its projection to the mean plane.
    """
    if corners.shape[2] == 2:
        edge = corners[:, 1] - corners[:, 0]
        return np.stack([edge[:, 1], -edge[:, 0]], axis=1)
    first, second = corners[:, -1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    return np.asarray(0.5 * np.cross(first, second), dtype=float)


def unit_normals(corners: FloatArray) -> FloatArray:
    """The unit normals (m, d) of facets (m, c, d), as :func:`facet_normals`."""
    normals = facet_normals(corners)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def corner_normals(kind: CellKind, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit normals (f, n, d) at the corners (f, n, d) of facets of a kind, and the weights (f, n).

    The normals are of either sign.  A facet with the edges e_i from a corner has the weight
    ``1/|e_1|`` there in 2D and ``sin(angle)/(|e_1| |e_2|)`` in 3D: the mean over the facets around
    a point is then exact on a circle and on a sphere (N. Max, 1999,
    doi:10.1080/10867651.1999.10487501).
    """
    if kind.dim == 1:
        edges = corners[:, 1] - corners[:, 0]
        sizes = np.linalg.norm(edges, axis=1)[:, None]
        unit = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / sizes
        return np.repeat(unit[:, None], 2, axis=1), np.tile(1.0 / sizes, 2)
    # The corners of the simplex beside each corner.
    beside = kind.beside * kind.corners if kind.is_simplex else kind.beside
    around = [(i, *(j for j in ends if j != i)) for i, ends in enumerate(beside)]
    at, start, end = (corners[:, list(places)] for places in zip(*around, strict=True))
    first, second = start - at, end - at
    normals = np.cross(first, second)
    sizes = np.linalg.norm(normals, axis=2)
    squares = np.sum(first**2, axis=2) * np.sum(second**2, axis=2)
    return normals / sizes[..., None], sizes / squares


@cache
def lagrange(cell: str, degree: int) -> Any:
    """Lagrange's element of a degree on a cell or a facet, whose ``points`` are its nodes."""
    import basix

    variant = basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, basix.CellType[cell], degree, variant)


def nodal_functions(cell: str, degree: int, points: FloatArray) -> FloatArray:
    """The values (q, n) of the functions of the nodes, in DOLFINx's order, at points (q, d)."""
    element = lagrange(cell, degree)
    if not len(points):
        # basix aborts without points.
        return np.zeros((0, element.dim))
    return np.asarray(element.tabulate(0, points)[0, :, :, 0])


def measures(kind: CellKind, corners: FloatArray) -> FloatArray:
    """The measures (k,) of cells with corners (k, c, d)."""
    slopes, weights = _slopes(kind)
    return np.abs(np.linalg.det(np.einsum("aqn,knd->kqda", slopes, corners))) @ weights


def mean_normals(kind: CellKind, corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The integrals of a normal (k, d) and of 1 (k,) over facets with corners (k, c, d)."""
    slopes, weights = _slopes(kind)
    along = np.einsum("aqn,knd->akqd", slopes, corners)
    if len(along) == 1:
        normals = np.stack([along[0][..., 1], -along[0][..., 0]], axis=-1)
    else:
        normals = np.cross(*along)
    return np.einsum("kqd,q->kd", normals, weights), np.linalg.norm(normals, axis=2) @ weights


def _slopes(kind: CellKind) -> tuple[FloatArray, FloatArray]:
    """The derivatives (dim, q, c) of the corners' functions at Gauss's points, and the weights."""
    import basix

    rule = 1 if kind.is_simplex else 2
    points, weights = basix.make_quadrature(basix.CellType[kind.name], rule)
    return lagrange(kind.name, 1).tabulate(1, points)[1:, :, :, 0], np.asarray(weights)


def keys(rows: IntArray, count: int) -> npt.NDArray[Any]:
    """A sortable value for each row (k, d) of numbers below ``count``; equal rows, equal values."""
    width = rows.shape[1]
    if count**width < 2**63:
        return rows @ count ** np.arange(width - 1, -1, -1, dtype=np.int64)
    return np.ascontiguousarray(rows.astype(">u8")).view(f"V{8 * width}").ravel()


def components(pairs: IntArray, size: int) -> tuple[int, IntArray]:
    """The number of components of a graph with so many nodes, and that (size,) of each node.

    ``pairs`` (k, 2) are the nodes that are joined.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (size, size))
    count, numbers = connected_components(graph, directed=False)
    return int(count), numbers.astype(np.int64)


def signed_measures(points: FloatArray, simplices: IntArray) -> FloatArray:
    """``d!`` times the signed volume (k,) of simplices (k, d + 1)."""
    origin = points[simplices[:, -1]]
    edges = [points[simplices[:, i]] - origin for i in range(points.shape[1])]
    if len(edges) == 2:
        a, b = edges
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    a, b, c = edges
    return np.einsum("ki,ki->k", a, np.cross(b, c))


def longest_edges(points: FloatArray, cells: IntArray) -> FloatArray:
    """The longest distance (k,) of two corners of each cell (k, c)."""
    width = cells.shape[1]
    longest = np.zeros(len(cells))
    for i in range(width):
        for j in range(i):
            edge = points[cells[:, i]] - points[cells[:, j]]
            np.maximum(longest, np.einsum("ki,ki->k", edge, edge), out=longest)
    return np.sqrt(longest)


@dataclass(frozen=True)
class MeshElements:
    """Elements of one kind with their physical groups.

    ``nodes`` (k, c) are indices of points in the order of `CellKind`, ``numbers`` (k,) are the
    numbers of the elements in the file, and ``groups`` (k,) are values of ``names``, or 0 for an
    element without a group.  A name has several values where elements have several names.
    """

    nodes: IntArray
    numbers: IntArray
    groups: IntArray
    names: Mapping[str, tuple[int, ...]]

    def __len__(self) -> int:
        return len(self.nodes)

    def named(self, name: str) -> BoolArray:
        """Which elements (k,) have a name; none if no group has the name."""
        return np.isin(self.groups, self.names.get(name, ()))

    def take(self, which: BoolArray) -> MeshElements:
        """The marked elements; the names stay."""
        return MeshElements(self.nodes[which], self.numbers[which], self.groups[which], self.names)


@dataclass(frozen=True)
class MeshData:
    """Points (m, dim), the numbers (m,) of the nodes in the file, cells and facets.

    ``unusable`` gives, for the name of every other group of facets, why the group bounds nothing.
    """

    dim: int
    points: FloatArray
    numbers: IntArray
    cells: MeshElements
    facets: MeshElements
    findings: tuple[Finding, ...] = ()
    unusable: Mapping[str, str] = field(default_factory=dict)

    @property
    def kind(self) -> CellKind:
        return KINDS[self.dim, self.cells.nodes.shape[1]]

    @property
    def empty(self) -> MeshData:
        """The mesh without points, cells and facets, with the same names and kind of cells."""
        cells, facets = (
            elements.take(np.zeros(len(elements), dtype=bool))
            for elements in (self.cells, self.facets)
        )
        return replace(
            self, points=self.points[:0], numbers=self.numbers[:0], cells=cells, facets=facets
        )

    def node_words(self, index: int) -> str:
        """A node by its number, with its coordinates."""
        return f"node {self.numbers[index]} at {point_words(self.points[index])}"

    def nodes_words(self, indices: IntArray) -> str:
        """Several nodes by their numbers."""
        return f"nodes {listed(self.numbers[indices])}"

    def cell_words(self, index: int) -> str:
        """A cell by its number, with its centre."""
        centre = self.points[self.cells.nodes[index]].mean(axis=0)
        return f"{self.kind.name} {self.cells.numbers[index]} at {point_words(centre)}"

    def facet_words(self, index: int) -> str:
        """A facet of a group by its number, with its centre."""
        centre = self.points[self.facets.nodes[index]].mean(axis=0)
        number = self.facets.numbers[index]
        return f"{self.kind.facet_word} {number} at {point_words(centre)}"


@contextmanager
def about(origin: str) -> Iterator[None]:
    """Put the origin of a mesh before the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{origin}: {error}", error.key) from None


#: The advice for a mesh of several kinds of cells.
ONE_KIND = (
    "a body needs cells of one kind: in Gmsh leave out Recombine and mesh again for simplices, or "
    "recombine every surface and volume (Mesh.RecombineAll with Mesh.SubdivisionAlgorithm = 1 for "
    "quadrilaterals, 2 for hexahedra)"
)


# A plane is flat up to this share of the largest coordinate.
_FLAT = 1e-12


def flat_points(points: FloatArray, numbers: IntArray, dim: int) -> FloatArray:
    """The coordinates (m, dim) of points.  Raises InputError for those of a surface in space."""
    if dim == 2 and points.shape[1] == 3:
        height = points[0, 2]
        off = np.abs(points[:, 2] - height) > _FLAT * np.abs(points).max()
        if off.any():
            first = int(np.argmax(off))
            raise InputError(
                f"it is a surface in space; a 2D body lies in a plane z = constant, and node "
                f"{numbers[0]} has z = {height:g}, node {numbers[first]} z = {points[first, 2]:g}"
            )
    return np.ascontiguousarray(points[:, :dim])


def named_elements(kind: CellKind, groups: Mapping[str, IntArray]) -> MeshElements:
    """The elements (k, c) of each group, one group after another, numbered from 0."""
    rows = [np.empty((0, kind.corners), dtype=np.int64), *groups.values()]
    nodes = np.concatenate(rows)
    tags = np.repeat(np.arange(len(rows)), [len(group) for group in rows])
    names = {name: (tag,) for tag, name in enumerate(groups, start=1)}
    return MeshElements(nodes, np.arange(len(nodes)), tags, names)


def point_words(point: FloatArray) -> str:
    """The coordinates of a point in brackets."""
    # Adding zero turns -0 into 0.
    return "(" + ", ".join(f"{x + 0.0:.6g}" for x in point) + ")"


def listed(numbers: IntArray) -> str:
    """Two numbers or more, with an "and" before the last."""
    *first, last = map(str, numbers)
    return f"{', '.join(first)} and {last}"


def and_more(count: int) -> str:
    """The number of further cases, for a message that names one; empty without any."""
    return f", and {count - 1} more" if count > 1 else ""


def is_xdmf(path: str | Path) -> bool:
    """Whether a mesh file is an XDMF file, which its ending tells."""
    return Path(path).suffix.lower() == ".xdmf"


def data_file(path: Path) -> Path:
    """The HDF5 file with the numbers of an XDMF file."""
    return path.with_suffix(".h5")
