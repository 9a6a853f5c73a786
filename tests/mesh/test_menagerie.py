"""Small mesh files in the ways of many programs: each is read right, or refused with a way out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from msh import MeshElements, msh

from contact_locking import InputError
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.parts import groups
from contact_locking.mesh.sources import from_file

gmsh = pytest.importorskip("gmsh")
pytestmark = pytest.mark.serial

# Two triangles, or one quadrilateral, of the square of side 2.
SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
SOLE: MeshElements = [(1, 2)]
TOP: MeshElements = [(3, 4)]
CELLS = [(1, 2, 3), (1, 3, 4)]
TET = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
CUBE = [(float(i & 1), float(i >> 1 & 1), float(i >> 2)) for i in (0, 1, 3, 2, 4, 5, 7, 6)]
PLAIN: dict[str, MeshElements] = {"sole": SOLE, "top": TOP, "body": CELLS}


@dataclass(frozen=True)
class Read:
    """What a file is read as: the measure of each group, and what a warning says."""

    measures: dict[str, float]
    warning: str = ""


Expected = Read | str
SQUARE_IS = Read({"sole": 2.0, "top": 2.0, "body": 4.0})
ALL: dict[str, tuple[Callable[[Path], Any], Expected]] = {}


def animal(name: str, expected: Expected) -> Callable[[Callable[[Path], Any]], Any]:
    """Add a function that writes a file into a folder; ``str`` is a part of the refusal."""

    def add(write: Callable[[Path], Any]) -> Any:
        assert name not in ALL
        ALL[name] = write, expected
        return write

    return add


def text(content: str, encoding: str = "utf-8") -> Callable[[Path], Path]:
    """A file of this text; line ends stay as they are."""

    def write(folder: Path) -> Path:
        path = folder / "part.msh"
        path.write_bytes(content.encode(encoding))
        return path

    return write


def with_gmsh(make: Callable[[Any], None], **options: float) -> Callable[[Path], Path]:
    """A file that Gmsh writes of what ``make`` has put into its model."""

    def write(folder: Path) -> Path:
        path = folder / "part.msh"
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.6)
            for name, value in options.items():
                gmsh.option.setNumber(f"Mesh.{name}", value)
            make(gmsh.model)
            gmsh.write(str(path))
        finally:
            gmsh.finalize()
        return path

    return write


def plate(model: Any, order: int = 1) -> None:
    """The square with its two parts."""
    body = model.occ.addRectangle(0, 0, 0, 2, 2)
    model.occ.synchronize()
    model.addPhysicalGroup(2, [body], name="body")
    for name, side in (("sole", 1), ("top", 3)):
        model.addPhysicalGroup(1, [side], name=name)
    model.mesh.generate(2)
    model.mesh.setOrder(order)


def xdmf(**options: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        meshio = pytest.importorskip("meshio")
        mesh = meshio.Mesh(np.array(SQUARE), [("triangle", np.array(CELLS) - 1)])
        meshio.write(folder / "part.xdmf", mesh, **options)
        return folder / "part.xdmf"

    return write


TEXT = msh(SQUARE, PLAIN)
IN_SPACE = [(x, y, 0.3 * x) for x, y in SQUARE]
animal("Gmsh 2.2, text", SQUARE_IS)(text(TEXT))
animal("line ends of Windows", SQUARE_IS)(text(TEXT.replace("\n", "\r\n")))
animal("names with blanks and umlauts", Read({"Unterseite außen": 2.0, "Körper 1": 4.0}))(
    text(msh(SQUARE, {"Unterseite außen": SOLE, "Körper 1": CELLS}))
)
animal("names in Latin-1", "not in UTF-8")(
    text(msh(SQUARE, {"Sohle außen": SOLE, "body": CELLS}), "latin-1")
)
NAMES = 'Names\n3\n1 1 "sole"\n1 2 "top"\n2 3 "body"\n'
animal("numbers in place of names", Read({"1": 2.0, "2": 2.0, "3": 4.0}))(
    text(TEXT.replace(NAMES, "Names\n0\n"))
)
animal("no group", Read({"body": 4.0}))(text(msh(SQUARE, {"": CELLS})))
animal("groups of cells alone", Read({"right": 2.0, "left": 2.0}))(
    text(msh(SQUARE, {"right": [CELLS[0]], "left": [CELLS[1]]}))
)
animal("a cell in two groups", "once more|share")(
    text(msh(SQUARE, {"sole": SOLE, "body": CELLS, "insert": [CELLS[0]]}))
)
animal("nodes numbered from a big offset", SQUARE_IS)(
    text(msh(SQUARE, PLAIN, numbers=[10**7 + i for i in (3, 1, 9, 4)]))
)
animal("a node of no cell", SQUARE_IS)(text(msh([*SQUARE, (9.0, 9.0)], PLAIN)))
animal("clockwise cells", SQUARE_IS)(
    text(msh(SQUARE, {"sole": [(2, 1)], "top": TOP, "body": [(1, 3, 2), (1, 3, 4)]}))
)
animal("a plane above the origin", SQUARE_IS)(text(msh([(x, y, 7.5) for x, y in SQUARE], PLAIN)))
animal("a tilted plane", "surface in space; a 2D body lies in a plane z = constant")(
    text(msh(IN_SPACE, PLAIN))
)
animal("a quadrilateral", SQUARE_IS)(
    text(msh(SQUARE, {"sole": SOLE, "top": TOP, "body": [(1, 2, 3, 4)]}))
)
animal("triangles and quadrilaterals", "is a Quadrilateral.*Recombine")(
    text(msh([*SQUARE, (4.0, 1.0)], {"sole": SOLE, "body": [(1, 2, 3, 4)], "wing": [(2, 5, 3)]}))
)
animal("a tetrahedron", Read({"sole": 0.5, "body": 1.0 / 6.0}))(
    text(msh(TET, {"sole": [(1, 2, 3)], "body": [(1, 2, 3, 4)]}))
)
animal("a hexahedron", Read({"sole": 1.0, "body": 1.0}))(
    text(msh(CUBE, {"sole": [(1, 2, 3, 4)], "body": [tuple(range(1, 9))]}))
)
animal("a prism", "Prism|prism|Wedge")(
    text(msh(TET, {"sole": [(1, 2, 3)], "body": [(1, 2, 3, 4)]}).replace(
        "2 4 2 2 2 1 2 3 4", "2 6 2 2 2 1 2 3 4 4 4"
    ))
)  # fmt: skip
for version, binary in ((2.2, 0), (2.2, 1), (4.0, 0), (4.1, 0), (4.1, 1)):
    animal(f"Gmsh {version}, {'binary' if binary else 'text'}, of Gmsh", SQUARE_IS)(
        with_gmsh(plate, MshFileVersion=version, Binary=binary)
    )
animal("straight triangles of second order", Read(SQUARE_IS.measures, "sides are straight"))(
    with_gmsh(lambda model: plate(model, order=2))
)
animal("triangles of third order", r"first or second order.*setOrder\(1\)")(
    with_gmsh(lambda model: plate(model, order=3))
)
animal("XDMF of meshio", Read({"Grid": 4.0}))(xdmf(data_format="HDF"))


@animal("XDMF with numbers in its text", "its numbers in part.h5.*meshio and data_format")
def numbers_in_text(folder: Path) -> Path:
    def item(shape: str, values: str) -> str:
        return f'<DataItem Dimensions="{shape}" Format="XML">{values}</DataItem>'

    path = folder / "part.xdmf"
    path.write_text(
        '<Xdmf Version="3.0"><Domain><Grid Name="mesh"><Topology TopologyType="Triangle">'
        f'{item("1 3", "0 1 2")}</Topology><Geometry GeometryType="XY">'
        f"{item('3 2', '0 0 1 0 0 1')}</Geometry></Grid></Domain></Xdmf>",
        encoding="utf-8",
    )
    return path


def read(path: Path) -> Domain:
    return from_file(path, MPI.COMM_SELF)


@pytest.mark.parametrize("name", ALL)
def test_a_mesh_file_is_read_right_or_refused_with_the_way_out(name: str, tmp_path: Path) -> None:
    write, expected = ALL[name]
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            read(write(tmp_path))
        return
    domain = read(write(tmp_path))
    found = {group.name: group.measure for group in groups(domain)}
    if expected.measures:
        assert found == pytest.approx(expected.measures)
    told = " ".join(domain.findings)
    assert expected.warning in told
    assert expected.warning or not told
