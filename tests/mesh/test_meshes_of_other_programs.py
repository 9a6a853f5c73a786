"""Meshes of other programs are written as Gmsh files, with their sets as named groups."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

from contact_locking import InputError
from contact_locking.command import cli
from contact_locking.mesh.domain import Domain, from_file
from contact_locking.mesh.file.conversion import convert

pytest.importorskip("meshio")
pytestmark = pytest.mark.serial

PLATE = """*HEADING
 two squares of two triangles
*NODE, NSET=ALL
1, 0., 0.
2, 1., 0.
3, 2., 0.
4, 0., 1.
5, 1., 1.
6, 2., 1.
*ELEMENT, TYPE=S3, ELSET=PLATE
1, 1, 2, 5
2, 1, 5, 4
3, 2, 3, 6
4, 2, 6, 5
*ELSET, ELSET=INSERT
3, 4
*NSET, NSET=SOLE
1, 2, 3
*NSET, NSET=SKIN
1, 2, 3, 4, 5, 6
*NSET, NSET=MIDDLE
2, 5
*END
"""
TETRAHEDRON = """*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 0., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4
1, 1, 2, 3, 4
*NSET, NSET=SOLE
1, 2, 3
*END
"""


def converted(folder: Path, deck: str) -> tuple[Domain, list[str]]:
    source, target = folder / "part.inp", folder / "part.msh"
    source.write_text(deck, encoding="utf-8")
    warnings = convert(source, target)
    return from_file(target, MPI.COMM_SELF), warnings


def test_sets_of_cells_are_regions_and_sets_of_nodes_are_boundary_parts(tmp_path: Path) -> None:
    domain, (warning,) = converted(tmp_path, PLATE)
    assert {name: len(domain.cells(name)) for name in domain.cell_names} == {
        "PLATE": 2,
        "INSERT": 2,
    }
    assert {name: len(domain.facets((name,))) for name in domain.facet_names} == {
        "SOLE": 2,
        "SKIN": 6,
    }
    assert "the set MIDDLE of nodes has no facet on the boundary" in warning


def test_a_deck_without_sets_of_cells_is_one_region(tmp_path: Path) -> None:
    domain, warnings = converted(tmp_path, TETRAHEDRON)
    assert domain.dim == 3 and list(domain.cell_names) == ["body"] and not warnings
    assert len(domain.facets(("SOLE",))) == 1


@pytest.mark.parametrize("dim", [2, 3])
def test_quadrilaterals_and_hexahedra_are_taken(dim: int, tmp_path: Path) -> None:
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = [(*c, 0) for c in square] + [(*c, 1) for c in square] * (dim == 3)
    lines = [f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(corners, start=1)]
    numbers = ", ".join(str(i) for i in range(1, len(corners) + 1))
    sole = "1, 2" if dim == 2 else "1, 2, 5, 6"
    kind = {2: "S4", 3: "C3D8"}[dim]
    cells = f"*ELEMENT, TYPE={kind}\n1, {numbers}\n*NSET, NSET=SOLE\n{sole}\n*END\n"
    domain, warnings = converted(tmp_path, "\n".join(["*NODE", *lines, cells]))
    assert domain.dim == dim and not warnings and not domain.kind.is_simplex
    assert len(domain.facets(("SOLE",))) == 1


@pytest.mark.parametrize(
    ("deck", "message"),
    [
        (PLATE.replace("S3", "UNKNOWN"), "cannot be read by meshio: .*UNKNOWN"),
        ("*NODE\n1, 0., 0.\n2, 1., 0.\n*ELEMENT, TYPE=T2D2\n1, 1, 2\n", "has the cells line;"),
        (
            PLATE.replace("*ELSET, E", "*ELEMENT, TYPE=S4\n9, 1, 2, 5, 4\n*ELSET, E"),
            "quad, triangle;",
        ),
        (
            TETRAHEDRON.replace("C3D4", "C3D10").replace("3, 4\n*N", "3, 4, 1, 2, 3, 4, 1, 2\n*N"),
            "tetra10",
        ),
    ],
)
def test_decks_with_other_cells_are_refused(tmp_path: Path, deck: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        converted(tmp_path, deck)


def test_the_command_writes_the_file_and_a_study_tells_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target, study = (tmp_path / name for name in ("part.inp", "part.msh", "study.yml"))
    source.write_text(PLATE, encoding="utf-8")
    study.write_text(
        "mesh: {file: part.inp}\ncontact: {on: SOLE}\n"
        "loads: {displacements: [{on: SKIN, value: [0, 0]}]}\n",
        encoding="utf-8",
    )
    assert cli.main(["check", str(study)]) == 2
    assert f"contact-locking mesh {source} -o {target}" in capsys.readouterr().err
    assert cli.main(["mesh", str(source), "-o", str(target)]) == 0
    assert capsys.readouterr().out == f"{target}: written\n" and target.exists()
