"""A mesh in an XDMF file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from small_meshes import BODY, REFUSED, SQUARE, Groups, study
from xdmf import export, write_xdmf

from contact_locking import check, study_file
from contact_locking.errors import InputError
from contact_locking.mesh.data import data_file
from contact_locking.mesh.parts import groups
from contact_locking.mesh.sources import from_file, from_geometry


def written(folder: Path, comm: MPI.Intracomm, *mesh: Any) -> Path:
    """A file of rank 0 that all ranks read."""
    path = folder / "body.xdmf"
    if comm.rank == 0:
        write_xdmf(path, *mesh)
    comm.Barrier()
    return path


# Each is found by another check; the texts are those of Gmsh files.
SAMPLE = (
    *("a coordinate that is no number", "three tetrahedra on a face", "a triangle twice"),
    *("a tetrahedron without volume", "a triangle turned over", "a hanging node in space"),
    *("nodes that nearly are at one place", "a cell in no group", "a node above the plane"),
)


@pytest.mark.parametrize("case", SAMPLE)
def test_a_mesh_that_is_no_body_is_refused_on_all_ranks(
    case: str, folder: Path, comm: MPI.Intracomm
) -> None:
    points, given, _ = REFUSED[case]
    path = written(folder, comm, points, given)
    with pytest.raises(InputError) as caught:
        from_file(path, comm)
    assert str(caught.value).startswith(str(path)) and caught.value.key == "mesh.file"


def test_numbers_of_nodes_that_are_not_there_are_refused(folder: Path, comm: MPI.Intracomm) -> None:
    for wrong in (0, 7):
        named: Groups = {**BODY, "body": [(1, 2, 3), (1, 3, wrong)]}
        path = written(folder, comm, SQUARE, named)
        with pytest.raises(InputError, match="triangle 1 names nodes that are none of its 4"):
            from_file(path, comm)


def test_nodes_without_cells_are_refused(folder: Path, comm: MPI.Intracomm) -> None:
    path = written(folder, comm, [*SQUARE, (3, 3)], BODY)
    with pytest.raises(InputError, match="1 of its 5 nodes belong to no cell"):
        from_file(path, comm)


@pytest.mark.parametrize(("dim", "h"), [(2, 0.25), (3, 0.5)])
def test_a_mesh_that_was_written_is_read_with_the_same_groups(
    dim: int, h: float, folder: Path, comm: MPI.Intracomm
) -> None:
    made = from_geometry(block(dim, h).mesh.geometry, comm)
    export(made, folder / "block.xdmf")
    read = from_file(folder / "block.xdmf", comm)
    assert read.cell_names == made.cell_names and read.facet_names == made.facet_names
    assert not read.findings and read.part_names == ("the body",)
    for one, two in zip(groups(made), groups(read), strict=True):
        assert (one.name, one.dim, one.count) == (two.name, two.dim, two.count)
        assert one.measure == pytest.approx(two.measure, rel=1e-12)
        assert one.normal == pytest.approx(two.normal, abs=1e-12)


def test_tags_with_several_values_are_groups_named_by_number(
    folder: Path, comm: MPI.Intracomm
) -> None:
    sides: Groups = {"facets": [(1, 2), (3, 4), (4, 1)], "cells": BODY["body"]}
    values = {"facets": [5, 8, 5], "cells": [1, 2]}
    domain = from_file(written(folder, comm, SQUARE, sides, values), comm)
    assert sorted(domain.cell_names) == ["1", "2"] and sorted(domain.facet_names) == ["5", "8"]
    counts = {group.name: group.count for group in groups(domain)}
    assert counts == {"1": 1, "2": 1, "5": 2, "8": 1}


def test_a_group_partly_inside_the_body_keeps_its_boundary_with_a_warning(
    folder: Path, comm: MPI.Intracomm
) -> None:
    named: Groups = {**BODY, "bottom": [(1, 2), (1, 3)]}
    facts = check(study(written(folder, comm, SQUARE, named)), comm)
    (finding,) = facts["findings"]
    assert (finding.code, finding.numbers["count"]) == ("mesh.group_off_boundary", 1)
    (bottom,) = [group for group in facts["groups"] if group.name == "bottom"]
    assert bottom.measure == pytest.approx(1.0)


@pytest.mark.serial
def test_the_fingerprint_of_a_study_knows_the_data_beside_the_file(tmp_path: Path) -> None:
    path = write_xdmf(tmp_path / "body.xdmf", SQUARE, BODY)
    parameters = study(path)
    before = study_file.fingerprint(parameters)
    assert study_file.fingerprint(parameters) == before
    text = path.read_text(encoding="utf-8")
    write_xdmf(path, [(x, 2 * y) for x, y in SQUARE], BODY)
    assert path.read_text(encoding="utf-8") == text
    assert study_file.fingerprint(parameters) != before


BAD: dict[str, tuple[str, str, str]] = {
    "no XML": ("<Xdmf", "<Xdmf <", "is not an XML file"),
    "data elsewhere": (
        "body.h5:/Mesh",
        "../other.h5:/Mesh",
        "needs its numbers in body.h5",
    ),
    "a curved cell": ('"Triangle"', '"Tri_6"', "write cells of one kind and of first order"),
    "a group twice": ('Name="top"', 'Name="left"', "two grids with one name"),
    "a name that is none": ('Name="top"', 'Name=""', "is not valid"),
    "a dataset that is not there": ("/MeshTags/1", "/MeshTags/9", "cannot be read with body.h5"),
}


@pytest.mark.serial
@pytest.mark.parametrize("case", BAD)
def test_a_damaged_file_is_refused(case: str, tmp_path: Path) -> None:
    path = write_xdmf(tmp_path / "body.xdmf", SQUARE, BODY)
    old, new, words = BAD[case]
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        from_file(path, MPI.COMM_SELF)
    assert words in str(caught.value) and caught.value.key == "mesh.file"


@pytest.mark.serial
def test_a_file_without_its_data_is_refused(tmp_path: Path) -> None:
    path = write_xdmf(tmp_path / "body.xdmf", SQUARE, BODY)
    whole = data_file(path).read_bytes()
    for content in (b"no HDF5", whole[: len(whole) // 2]):
        data_file(path).write_bytes(content)
        with pytest.raises(InputError, match=r"cannot be read with body\.h5"):
            from_file(path, MPI.COMM_SELF)
    data_file(path).unlink()
    with pytest.raises(InputError, match=r"needs its numbers in body\.h5"):
        from_file(path, MPI.COMM_SELF)


def test_shares_of_the_parts_add_up(folder: Path, comm: MPI.Intracomm) -> None:
    """A row of squares that touch nothing, in an order that mixes them on the ranks."""
    points = [(2.0 * i + x, y) for i in range(5) for x, y in SQUARE]
    cells = [(4 * i + a, 4 * i + b, 4 * i + c) for a, b, c in BODY["body"] for i in range(5)]
    domain = from_file(written(folder, comm, points, {"left": [(4, 1)], "body": cells}), comm)
    areas = np.bincount(domain.parts, minlength=5)
    assert list(comm.allreduce(areas)) == [2] * 5
    for number, name in enumerate(domain.part_names):
        assert f"part {number + 1} of the body (body, from ({2 * number}, 0)" in name
    assert math.isclose(domain.bounding_box[1, 0], 9.0)
