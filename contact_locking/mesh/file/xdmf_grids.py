"""The grids of an XDMF file: the mesh of a body and its groups of cells and facets.

The XML file holds names and sizes.  The numbers are in an HDF5 file beside it, which has the same
name with the ending .h5; DOLFINx reads no other file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from contact_locking.errors import InputError
from contact_locking.mesh.cell_kind import INTERVAL, NAMED, CellKind
from contact_locking.mesh.file import places
from contact_locking.mesh.file.reader import require_file

ENDING = ".xdmf"
_HDF5 = b"\x89HDF\r\n\x1a\n"
# A grid takes less than 1 kB, and a mesh does not have thousands of groups.
_LARGEST = 1_000_000
_WRITE = "write them to an HDF5 file, as dolfinx.io.XDMFFile does, or meshio with data_format='HDF'"
# Where the version of the superblock of HDF5 stands, and by version the end of the file.
_VERSION, _END = 8, {0: 40, 1: 44, 2: 28, 3: 28}
_KINDS = {"polyline": INTERVAL, **NAMED}


@dataclass(frozen=True)
class Grid:
    """The elements of one kind under one name, and whether they have values."""

    name: str
    kind: CellKind
    has_values: bool

    @property
    def dim(self) -> int:
        return self.kind.dim


@dataclass(frozen=True)
class Grids:
    """The grid of the ``cells`` of the body, and the ``groups`` of cells and facets."""

    cells: Grid
    groups: tuple[Grid, ...]

    @property
    def dim(self) -> int:
        return self.cells.dim

    @property
    def regions(self) -> tuple[Grid, ...]:
        return tuple(grid for grid in self.groups if grid.dim == self.dim)

    @property
    def boundary_parts(self) -> tuple[Grid, ...]:
        return tuple(grid for grid in self.groups if grid.dim == self.dim - 1)


def is_xdmf(path: str | Path) -> bool:
    """Whether a mesh file is an XDMF file, which its ending tells."""
    return Path(path).suffix.lower() == ENDING


def data_file(path: Path) -> Path:
    """The HDF5 file with the numbers of an XDMF file."""
    return path.with_suffix(".h5")


def read_grids(path: Path) -> Grids:
    """The grids of a file; for one process.

    The first grid is the mesh.  Every other grid has tags of cells or facets, and is a group.
    Raises InputError for a file that is no mesh of cells of one kind.
    """
    cells, *groups = _listed(path)
    if cells.dim < 2:
        raise InputError(f"{path} is a 1D mesh; a body in 2D or 3D is needed")
    for grid in groups:
        if grid.kind not in (cells.kind, cells.kind.facet):
            raise InputError(
                f"{path}: grid {grid.name!r} has neither {cells.kind.plural} nor "
                f"{places.of_facets(cells.kind)}s of the body"
            )
    return Grids(cells, tuple(groups))


def read_facet_grids(path: Path, cells: CellKind) -> tuple[Grid, tuple[Grid, ...]]:
    """The first grid of a file, which has its points, and those with tags of facets.

    For one process.  The first grid may be a mesh without values.  Raises InputError for a file
    with anything else.
    """
    first, *others = _listed(path)
    tags = [*([first] if first.has_values else []), *others]
    facets = f"{places.of_facets(cells)}s"
    for grid in tags:
        if grid.kind != cells.facet or not grid.has_values:
            raise InputError(f"{path}: grid {grid.name!r} has no tags of {facets}")
    if not tags:
        raise InputError(f"{path} has no tags of {facets}, but a mesh alone")
    return first, tuple(tags)


def _listed(path: Path) -> list[Grid]:
    """All grids of a file, one at least, with different names."""
    require_file(path)
    if path.stat().st_size > _LARGEST:
        size = f"{path.stat().st_size / 1e6:.1f} MB"
        raise InputError(f"{path} has {size}, and holds its numbers itself; {_WRITE}")
    content = path.read_bytes()
    if b"<!ENTITY" in content:
        raise InputError(f"{path} defines XML entities, which are not read")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is not an XML file: {error}") from None
    items = list(root.iter("DataItem"))
    if any(item.get("Format") == "XML" for item in items):
        raise InputError(f"{path}: numbers in the text of XDMF are not read; {_WRITE}")
    _require_whole(data_file(path))
    for item in items:
        file = (item.text or "").strip().partition(":")[0]
        if item.get("Format") != "HDF" or file != data_file(path).name:
            raise InputError(
                f"{path} refers to other data than those in {data_file(path).name}: DOLFINx reads "
                "the HDF5 file with the same name beside the file"
            )
    grids = [_grid(grid, path) for grid in root.iterfind("Domain/Grid")]
    if not grids:
        raise InputError(f"{path} holds no grid; write the mesh first")
    names = [grid.name for grid in grids]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise InputError(f"{path} has two grids named {min(twice)!r}")
    return grids


def _require_whole(path: Path) -> None:
    """Raise InputError unless an HDF5 file has all its bytes: HDF5 would print its own errors."""
    require_file(path)
    with path.open("rb") as stream:
        head = stream.read(64)
    if not head.startswith(_HDF5):
        raise InputError(f"{path} is not an HDF5 file")
    place = _END.get(head[_VERSION] if len(head) > _VERSION else -1, 0)
    end, size = int.from_bytes(head[place : place + 8], "little"), path.stat().st_size
    if place and size < end:
        raise InputError(f"{path} is truncated: it has {size} of {end} bytes; write it again")


def _grid(grid: ElementTree.Element, path: Path) -> Grid:
    name, topology = grid.get("Name", ""), grid.find("Topology")
    kind = "" if topology is None else topology.get("TopologyType", "")
    # Names are printed, and terminals read some characters as commands; quotes end an XPath.
    if not name or not name.isprintable() or "'" in name:
        raise InputError(f"{path}: the name of a grid is {name!a}, which is no name")
    if kind.lower() == "mixed":
        raise InputError(f"{path}: grid {name!r} has cells of several kinds; {places.ONE_KIND}")
    if kind.lower() not in _KINDS:
        known = ", ".join(kind.plural for kind in NAMED.values())
        raise InputError(
            f"{path}: grid {name!r} has the topology {kind!a}; only these of first order are "
            f"supported: {known}, with lines, triangles and quadrilaterals as their facets"
        )
    return Grid(name, _KINDS[kind.lower()], grid.find("Attribute") is not None)
