"""Decks of Abaqus and CalculiX are read with their sets as named groups."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI

from contact_locking import InputError
from contact_locking.command import cli
from contact_locking.findings import Finding
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.parts import groups
from contact_locking.mesh.sources import from_file

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


def converted(folder: Path, deck: str) -> tuple[Domain, list[Finding]]:
    source = folder / "part.inp"
    source.write_text(deck, encoding="utf-8")
    domain = from_file(source, MPI.COMM_SELF)
    return domain, list(domain.findings)


def test_sets_of_cells_are_regions_and_sets_of_nodes_are_boundary_parts(tmp_path: Path) -> None:
    domain, (finding,) = converted(tmp_path, PLATE)
    assert {name: len(domain.cells(name)) for name in domain.cell_names} == {
        "PLATE": 2,
        "INSERT": 2,
    }
    assert {name: len(domain.facets((name,))) for name in domain.facet_names} == {
        "SOLE": 2,
        "SKIN": 6,
    }
    assert (finding.code, finding.numbers) == ("mesh.empty_sets", {"names": "MIDDLE"})


@pytest.mark.parametrize(
    ("deck", "message"),
    [
        (PLATE.replace("S3", "UNKNOWN"), "has the cells 4 UNKNOWN;"),
        ("*NODE\n1, 0., 0.\n2, 1., 0.\n*ELEMENT, TYPE=T2D2\n1, 1, 2\n", "has the cells 1 T2D2;"),
        (PLATE.replace("*ELSET, E", "*ELEMENT, TYPE=S4\n9, 1, 2, 5, 4\n*ELSET, E"), "4 S3, 1 S4;"),
        (TETRAHEDRON.replace("C3D4", "C3D6"), "ELEMENT is wrong"),
        (TETRAHEDRON.replace("1, 2, 3, 4", "1, 2, 3, 9"), "node 9 of an element"),
        (TETRAHEDRON.replace("*NODE", "*NODE, SYSTEM=C"), "Cartesian"),
        (TETRAHEDRON.replace("*NSET, N", "*NGEN\n1, 3, 1\n*NSET, N"), "preprocessor write all"),
        (TETRAHEDRON.replace("*NSET, N", "*INCLUDE, INPUT=none.inp\n*NSET, N"), "No such file"),
        (TETRAHEDRON.replace("*NSET, N", "*INCLUDE, INPUT=part.inp\n*NSET, N"), "includes itself"),
    ],
)
def test_decks_that_are_no_body_are_refused(tmp_path: Path, deck: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        converted(tmp_path, deck)


SQUARE_NODES = "1, 0., 0.\n2, 1., 0.\n3, 1., 1.\n4, 0., 1.\n"
MIDDLES = "5, .5, 0.\n6, 1., .5\n7, .5, 1.\n8, 0., .5\n"
CUBE_NODES = "".join(
    f"{number}, {x}, {y}, {z}\n"
    for number, (x, y, z) in enumerate(
        ((x, y, z) for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))), start=1
    )
)
CUBE = f"*NODE, NSET=NALL\n{CUBE_NODES}*ELEMENT, TYPE=C3D8R, ELSET=BODY\n1, 1,2,3,4,5,6,7,8\n"


def sizes(domain: Domain) -> dict[str, int]:
    return {name: len(domain.facets((name,))) for name in domain.facet_names}


@pytest.mark.parametrize("kind", ["CPS4R", "CAX4", "CPE8", "S8R5"])
def test_quadrilaterals_of_every_name_are_read_with_their_surfaces(
    kind: str, tmp_path: Path
) -> None:
    second = "8" in kind
    cell = "1, 1,2,3,4,\n5,6,7,8" if second else "1, 1,2,3,4"
    deck = f"*NODE\n{SQUARE_NODES}{MIDDLES}*ELEMENT, TYPE={kind}, ELSET=BODY\n{cell}\n"
    deck += "*SURFACE, NAME=SOLE, TYPE=ELEMENT\n1, S1\n*SURFACE, NAME=ROUND\nBODY\n"
    domain, findings = converted(tmp_path, deck)
    assert sizes(domain) == {"SOLE": 1, "ROUND": 4} and len(findings) == second


@pytest.mark.parametrize("side", [1, 3, 6])
def test_each_side_of_a_hexahedron_is_that_of_abaqus(side: int, tmp_path: Path) -> None:
    domain, _ = converted(tmp_path, f"{CUBE}*SURFACE, NAME=ONE\nBODY, S{side}\n")
    places = ("z = 0", "z = 1", "y = 0", "x = 1", "y = 1", "x = 0")
    (group,) = (one for one in groups(domain) if one.name == "ONE")
    axis, value = places[side - 1].split(" = ")
    normal = [0.0, 0.0, 0.0]
    normal["xyz".index(axis)] = 2.0 * float(value) - 1.0
    assert group.normal == pytest.approx(normal)


def test_elements_of_other_kinds_are_left_out_and_counted(tmp_path: Path) -> None:
    deck = CUBE + (
        "*ELEMENT, TYPE=SPRINGA, ELSET=SP\n2, 1, 2\n3, 2, 3\n*ELEMENT, TYPE=MASS, ELSET=M\n4, 1\n"
        "*ELEMENT, TYPE=S4, ELSET=SKIN\n5, 1,2,3,4\n*ELEMENT, TYPE=DCOUP3D\n6, 1\n"
        "*ELSET, ELSET=ALL\nBODY, SP, M\n"
    )
    domain, (finding,) = converted(tmp_path, deck)
    assert (finding.code, finding.numbers["count"]) == ("mesh.other_elements", 5)
    assert finding.numbers["elements"] == "1 DCOUP3D, 1 MASS, 1 S4, 2 SPRINGA"
    assert domain.num_cells == 1 and sizes(domain) == {"SKIN": 1}


def test_sets_are_generated_with_and_without_their_step_and_name_other_sets(tmp_path: Path) -> None:
    deck = CUBE + (
        "*NSET, NSET=SOLE, GENERATE\n1, 4\n*NSET, NSET=FRONT, GENERATE\n1, 2, 1\n5, 6\n"
        "*NSET, NSET=ODD, GENERATE\n1, 7, 2\n*NSET, NSET=BOTH\nSOLE, 5, 6\nODD\n"
        "*ELSET, ELSET=E, GENERATE\n1, 1\n*NSET, NSET=OF_E, ELSET=E\n"
        "*SURFACE, NAME=NODES, TYPE=NODE\nSOLE,\n"
    )
    domain, (finding,) = converted(tmp_path, deck)
    # BOTH has the nodes 1 to 7.
    expected = {"SOLE": 1, "FRONT": 1, "BOTH": 3, "OF_E": 6, "NODES": 1}
    assert sizes(domain) == expected
    assert (finding.code, finding.numbers) == ("mesh.empty_sets", {"names": "ODD"})


PART = f"*Part, name=Cube\n{CUBE}*NSET, NSET=SOLE\n1, 2, 3, 4\n*NSET, NSET=Top\n1\n*End Part\n"


def test_a_part_keeps_the_names_of_its_sets_apart_from_those_of_the_assembly(
    tmp_path: Path,
) -> None:
    deck = (
        f"*HEADING\n{PART}*Assembly, name=A\n*Instance, name=One, part=Cube\n*End Instance\n"
        "*Nset, nset=Top, instance=One\n5, 6, 7, 8\n*Nset, nset=Both\nOne.SOLE, One.5, Top\n"
        "*Elset, elset=_Wall_S4, internal, instance=One\n1,\n"
        "*Surface, type=ELEMENT, name=Wall\n_Wall_S4, S4\n*End Assembly\n"
    )
    domain, (finding,) = converted(tmp_path, deck)
    assert finding.numbers == {"names": "Cube.Top"} and domain.num_cells == 1
    assert sizes(domain) == {"Cube.SOLE": 1, "Top": 1, "Both": 6, "Wall": 1}
    assert set(domain.cell_names) == {"Cube.BODY"}


@pytest.mark.parametrize(
    "place", ["3., 0., 0.\n*End Instance", "*End Instance\n*Instance, part=Cube"]
)
def test_instances_at_other_places_are_refused(place: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Do not use parts and assemblies"):
        converted(tmp_path, f"{PART}*Instance, name=One, part=Cube\n{place}\n")


def test_a_study_reads_a_deck_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, study = tmp_path / "part.inp", tmp_path / "study.yml"
    source.write_text(PLATE, encoding="utf-8")
    study.write_text(
        "mesh: {file: part.inp, parts: {top: {on: SKIN, facing: [0, 1]}}}\n"
        "contact: {on: SOLE, gap: 0.1}\nloads: {displacements: [{on: top, value: [0, 0]}]}\n",
        encoding="utf-8",
    )
    assert cli.main(["check", str(study)]) == 0
    assert "SOLE" in capsys.readouterr().out
    assert cli.main(["mesh", str(source), "-o", str(tmp_path / "part.msh")]) == 2
    assert f"mesh.file: {source}" in capsys.readouterr().err
