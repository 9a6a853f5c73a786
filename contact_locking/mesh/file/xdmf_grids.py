"""The grids of an XDMF file: the mesh of a body and its groups of cells and facets.

DOLFINx reads grids by their names, and does not list the names.  The numbers are in an HDF5 file
beside the file, which has the same name with the ending .h5; DOLFINx reads no other file.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from contact_locking.errors import InputError
from contact_locking.files.readable import require_file
from contact_locking.mesh.cell_kind import INTERVAL, NAMED, CellKind
from contact_locking.mesh.file import places

ENDING = ".xdmf"
_KINDS = {"polyline": INTERVAL, **NAMED}


@dataclass(frozen=True)
class Grid:
    """The elements of one kind under one name."""

    name: str
    kind: CellKind

    @property
    def dim(self) -> int:
        return self.kind.dim


def is_xdmf(path: str | Path) -> bool:
    """Whether a mesh file is an XDMF file, which its ending tells."""
    return Path(path).suffix.lower() == ENDING


def data_file(path: Path) -> Path:
    """The HDF5 file with the numbers of an XDMF file."""
    return path.with_suffix(".h5")


def read_grids(path: Path) -> tuple[Grid, list[Grid]]:
    """The grid of the cells of the body, and those of groups of cells and facets; for one process.

    The first grid is the mesh.  Every other grid has tags of cells or facets, and is a group.
    Raises InputError for a file that is no mesh of cells of one kind.
    """
    require_file(path)
    try:
        root = ElementTree.parse(path).getroot()
    except ElementTree.ParseError as error:
        raise InputError(f"{path} is not an XML file: {error}") from None
    data = data_file(path)
    sources = [(item.text or "").strip().partition(":")[0] for item in root.iter("DataItem")]
    if not data.exists() or any(source != data.name for source in sources):
        raise InputError(
            f"{path} does not have its numbers in {data.name} beside it: write it with "
            "dolfinx.io.XDMFFile, or with meshio and data_format='HDF'"
        )
    grids = [_grid(grid, path) for grid in root.iterfind("Domain/Grid")]
    if not grids:
        raise InputError(f"{path} holds no grid; write the mesh first")
    if len({grid.name for grid in grids}) < len(grids):
        raise InputError(f"{path} has two grids with one name")
    cells, *groups = grids
    if cells.dim < 2:
        raise InputError(f"{path} is a 1D mesh; a body in 2D or 3D is needed")
    for grid in groups:
        if grid.kind not in (cells.kind, cells.kind.facet):
            raise InputError(
                f"{path}: grid {grid.name!r} has neither {cells.kind.plural} nor "
                f"{places.of_facets(cells.kind)}s of the body"
            )
    return cells, groups


def _grid(grid: ElementTree.Element, path: Path) -> Grid:
    name, topology = grid.get("Name", ""), grid.find("Topology")
    kind = "" if topology is None else topology.get("TopologyType", "")
    # Names are printed, and terminals read some characters as commands; quotes end an XPath.
    if not name or not name.isprintable() or "'" in name:
        raise InputError(f"{path}: the name of a grid is {name!a}, which is no name")
    if kind.lower() not in _KINDS:
        known = ", ".join(kind.plural for kind in NAMED.values())
        raise InputError(
            f"{path}: grid {name!r} has the topology {kind!a}; write cells of one kind and of "
            f"first order ({known}), and tags of them and of their facets"
        )
    return Grid(name, _KINDS[kind.lower()])
