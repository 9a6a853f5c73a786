"""A mesh as NumPy arrays, a file of these arrays, and the words of messages about them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.findings import Finding
from contact_locking.mesh.cell_kind import KINDS, CellKind


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
