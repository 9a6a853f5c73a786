"""Boundary parts by place: what they catch, what they may overlap, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from msh import write_msh
from problems import block
from small_meshes import BODY, SQUARE
from xdmf import write_xdmf

from contact_locking import InputError, assemble, from_mapping
from contact_locking.mesh.parts import groups
from contact_locking.running.assembly import mesh_of
from contact_locking.study_file.parameters import Parameters

PARTS: dict[str, Any] = {
    "roof": {"plane": {"point": [0.3, 1.0], "normal": [0.0, -2.0]}},
    "corner": {"box": [[0.5, 0.0], [1.0, 0.5]]},
    "pad": {"on": "bottom", "expression": "x < 0.5"},
    "rest": {"on": ["bottom", "left"], "expression": "not (x < 0.5 and y < 1e-9)"},
    "all of it": {"box": [[-float("inf")] * 2, [float("inf")] * 2]},
}


def placed(parts: dict[str, Any], **changes: Any) -> Parameters:
    return block(h=0.125, mesh__structured=True, mesh__parts=parts, **changes)


def test_a_part_has_the_facets_of_its_place(comm: MPI.Intracomm) -> None:
    domain = mesh_of(placed(PARTS), comm)
    found = {group.name: group for group in groups(domain)}
    expected = {"roof": 8, "corner": 8, "pad": 4, "rest": 12, "all of it": 32, "bottom": 8}
    assert {name: found[name].count for name in expected} == expected
    assert found["roof"].normal == pytest.approx((0.0, 1.0))
    assert found["corner"].measure == pytest.approx(1.0)


def lattice(
    folder: Path, comm: MPI.Intracomm, counts: tuple[int, ...], holes: list[tuple[int, ...]]
) -> str:
    """The file of a lattice of unit boxes, of two triangles in 2D, without some boxes."""
    path = comm.bcast(folder) / "hollow.msh"
    if comm.rank == 0:
        points = [*np.ndindex(*(count + 1 for count in counts))]
        numbers = {point: number for number, point in enumerate(points, start=1)}
        square = [(0, 0), (1, 0), (1, 1), (0, 1)]
        around: Any = [square[:3], [*square[2:], square[0]]]
        if len(counts) == 3:
            around = [[(*corner, z) for z in (0, 1) for corner in square]]
        cells = [
            [numbers[tuple(np.add(box, corner))] for corner in corners]
            for box in np.ndindex(*counts)
            for corners in around
            if box not in holes
        ]
        write_msh(path, points, {"body": cells})
    comm.Barrier()
    return str(path)


def hollow(
    folder: Path, comm: MPI.Intracomm, counts: tuple[int, ...], hole: tuple[int, ...], parts: Any
) -> dict[str, tuple[int, Any]]:
    """The facets and mean normals of parts of a lattice of unit boxes with a box missing."""
    path = lattice(folder, comm, counts, [hole])
    mesh = {"file": path, "parts": parts, "axisymmetric": counts[0] == 2}
    domain = mesh_of(from_mapping({"mesh": mesh, "contact": {"on": []}}), comm)
    return {group.name: (group.count, group.normal) for group in groups(domain)}


SKINS: dict[str, Any] = {"cavity": {"skin": "inner"}, "outside": {"skin": "outer"}}


def test_the_skin_of_a_cavity_is_a_part(tmp_path: Path, comm: MPI.Intracomm) -> None:
    parts = SKINS | {"floor": {"skin": "inner", "facing": [0, 0, 2]}}
    found = hollow(tmp_path, comm, (3, 3, 3), (1, 1, 1), parts)
    assert {name: found[name][0] for name in parts} == {"cavity": 6, "outside": 54, "floor": 1}
    assert found["floor"][1] == pytest.approx((0.0, 0.0, 1.0))
    assert found["cavity"][1] == pytest.approx((0.0, 0.0, 0.0))


def test_a_cavity_on_the_axis_of_revolution_has_a_skin_of_its_own(
    tmp_path: Path, comm: MPI.Intracomm
) -> None:
    found = hollow(tmp_path, comm, (2, 3), (0, 1), SKINS)
    assert (found["cavity"][0], found["outside"][0]) == (3, 7)


def test_facets_face_a_direction_within_other_places(comm: MPI.Intracomm) -> None:
    parts = {
        "up": {"facing": [0, 1]},
        "slanting": {"facing": [1, 1]},
        "tip": {"on": "slanting", "box": [[0.5, 0.5], [1, 1]], "facing": [1, -1]},
    }
    domain = mesh_of(placed(parts), comm)
    found = {group.name: group.count for group in groups(domain)}
    assert {name: found[name] for name in parts} == {"up": 8, "slanting": 16, "tip": 4}


def test_a_part_without_facets_is_refused_with_the_place_of_the_boundary(
    comm: MPI.Intracomm,
) -> None:
    given = placed({"new": {"plane": {"point": [0, 0.5], "normal": [0, 1]}}})
    with pytest.raises(InputError, match="catches no facet of the boundary, which is between x"):
        mesh_of(given, comm)


def test_groups_of_a_file_may_overlap(tmp_path: Path, comm: MPI.Intracomm) -> None:
    folder = comm.bcast(tmp_path)
    sides = {"bottom": [(1, 2)], "sole": [(2, 1)], "round": [(1, 2), (2, 3)], "left": [(4, 1)]}
    measures = {"bottom": 1.0, "sole": 1.0, "round": 2.0, "left": 1.0}
    if comm.rank == 0:
        write_msh(folder / "square.msh", SQUARE, {**sides, "body": BODY["body"]})
        write_xdmf(folder / "square.xdmf", SQUARE, {**sides, "body": BODY["body"]})
    comm.Barrier()
    for name in ("square.msh", "square.xdmf"):
        given = from_mapping({"mesh": {"file": str(folder / name)}, "contact": {"on": "sole"}})
        found = {group.name: group.measure for group in groups(mesh_of(given, comm))}
        assert {name: found[name] for name in sides} == measures


def test_h_contact_refines_the_part_that_contains_a_placed_contact(comm: MPI.Intracomm) -> None:
    parts = {"pad": {"on": "right", "expression": "y < 0.5"}}
    given = from_mapping(
        {
            "mesh": {"builder": "block", "h": 0.25, "h_contact": 0.05, "parts": parts},
            "contact": {"on": "pad"},
            "loads": {"displacements": [{"on": "left", "value": [0, 0]}]},
        }
    )
    problem = assemble(given, comm)
    surface = problem.contacts[0].surface
    assert problem.domain.facet_diameter(problem.domain.facets(("pad",))) < 0.1
    assert np.all(surface.points[:, 0] == pytest.approx(1.0))
    problem.close()
