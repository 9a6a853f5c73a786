"""Meshes that are no body are refused with entity and place; suspicious ones are warned of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from msh import write_msh
from small_meshes import (
    BODY,
    EDGES,
    FAR,
    LOOSE,
    REFUSED,
    SQUARE,
    Groups,
    builder,
    shared,
    side_by_side,
    study,
)

from contact_locking import check
from contact_locking.errors import InputError
from contact_locking.mesh.parts import Group, groups
from contact_locking.mesh.sources import from_file, from_geometry
from contact_locking.meshes import BUILDERS, write


@pytest.mark.serial
@pytest.mark.parametrize("case", REFUSED)
def test_a_mesh_that_is_no_body_is_refused_with_entity_and_place(case: str, tmp_path: Path) -> None:
    points, groups, expected = REFUSED[case]
    path = write_msh(tmp_path / "body.msh", points, groups)
    with pytest.raises(InputError) as caught:
        from_file(path, MPI.COMM_SELF)
    message = str(caught.value)
    assert message.startswith(str(path)) and caught.value.key == "mesh.file"
    for words in expected:
        assert words in message


def test_a_group_off_the_body_is_refused_where_it_is_used_and_else_warned_of(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    named: Groups = {"dangling": [(5, 6)], **BODY}
    path = shared(comm, tmp_path, [*SQUARE, (2, 0), (3, 0)], named)
    (finding,) = check(study(path), comm)["findings"]
    assert finding.code == "mesh.group_off_boundary" and finding.key == str(path)
    assert finding.numbers["count"] == 1
    with pytest.raises(InputError, match="'dangling': 1 of its 1 lines are not") as caught:
        check(study(path, contact={"on": "dangling"}), comm)
    assert caught.value.key == "contact.on"


def test_a_group_inside_the_body_is_refused_where_it_is_used(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    path = shared(comm, tmp_path, SQUARE, {**BODY, "diagonal": [(1, 3)]})
    assert check(study(path), comm)["findings"] == []
    with pytest.raises(
        InputError, match="'diagonal': 1 of its 1 lines are not on the boundary"
    ) as caught:
        check(study(path, contact={"on": "diagonal"}), comm)
    assert caught.value.key == "contact.on"


def test_cells_without_any_group_are_one_region(comm: MPI.Intracomm, tmp_path: Path) -> None:
    """Also in another plane than z = 0, as programs export them."""
    raised = [(*point, 2.0) for point in SQUARE]
    file = shared(comm, tmp_path, raised, {**EDGES, "": [(1, 2, 3), (1, 3, 4)]})
    domain = from_file(file, comm)
    assert list(domain.cell_names) == ["body"] and domain.dim == 2
    assert comm.allreduce(len(domain.cells("body"))) == 2


def test_a_crack_is_a_warning(comm: MPI.Intracomm, tmp_path: Path) -> None:
    """Two of the four triangles about the middle have a node of their own on the left."""
    points = [*SQUARE, (0.5, 0.5), (0, 0.5), (0, 0.5)]
    body = [(1, 2, 5), (2, 3, 5), (3, 4, 5), (1, 5, 6), (7, 5, 4)]
    named: Groups = {"bottom": [(1, 2)], "left": [(1, 6), (7, 4)], "body": body}
    (finding,) = check(study(shared(comm, tmp_path, points, named)), comm)["findings"]
    assert finding.code == "mesh.cut"
    assert finding.numbers["nodes"] == "nodes 6 and 7 are both at (0, 0.5)"


def test_parts_that_meet_in_a_node_are_parts(comm: MPI.Intracomm, tmp_path: Path) -> None:
    points = [*SQUARE, (2, 1), (2, 2)]
    named: Groups = {**BODY, "corner": [(3, 5, 6)], "far": [(5, 6)]}
    path = shared(comm, tmp_path, points, named)
    with pytest.raises(InputError, match=r"part 2 of the body \(corner, from \(1, 1\) to \(2, 2\)"):
        check(study(path), comm)


def test_a_thin_triangle_is_a_warning(comm: MPI.Intracomm, tmp_path: Path) -> None:
    points, named = [*SQUARE, (0.5, -1e-8)], {**BODY, "body": [*BODY["body"], (1, 2, 5)]}
    domain = from_file(shared(comm, tmp_path, points, named), comm)
    (finding,) = domain.findings
    assert (finding.code, finding.numbers["count"]) == ("mesh.thin_cells", 1)
    assert finding.numbers["cell"] == "triangle 6 at (0.5, -3.33333e-09)"


@pytest.mark.parametrize("contact", ["bottom", ["bottom", "shore"]])
def test_a_part_that_nothing_holds_is_named_with_its_place(
    contact: Any, comm: MPI.Intracomm, tmp_path: Path
) -> None:
    path = shared(comm, tmp_path, SQUARE + FAR, LOOSE)
    with pytest.raises(InputError) as caught:
        check(study(path, contact={"on": contact}), comm)
    message = str(caught.value)
    assert "part 2 of the body (island, from (3, 0) to (4, 1)) is loose" in message
    assert caught.value.key == "loads.displacements"


@pytest.mark.serial
@pytest.mark.parametrize(("dim", "h"), [(2, 0.25), (3, 0.5)])
def test_a_file_gives_the_same_domain_as_the_builder_that_wrote_it(
    dim: int, h: float, comm: MPI.Intracomm, tmp_path: Path
) -> None:
    block = builder("block", dim=dim, h=h)
    path = Path(comm.bcast(str(tmp_path))) / "block.msh"
    if comm.rank == 0:
        write(block, path)
    comm.Barrier()
    one, two = from_geometry(block, comm), from_file(path, comm)
    assert (one.facet_names, one.cell_names) == (two.facet_names, two.cell_names)
    assert not two.findings and two.part_names == ("the body",)
    assert two.mesh.geometry.x == pytest.approx(one.mesh.geometry.x, abs=1e-12)
    for name in one.facet_names:
        assert np.array_equal(one.facets([name]), two.facets([name]))


def groups_of(comm: MPI.Intracomm, name: str, **given: Any) -> dict[str, Group]:
    return {group.name: group for group in groups(from_geometry(builder(name, **given), comm))}


@pytest.mark.serial
def test_groups_have_measure_and_normal(comm: MPI.Intracomm) -> None:
    found = groups_of(comm, "block", dim=3, h=0.5)
    assert found["body"].measure == pytest.approx(1.0) and found["body"].facing() == ""
    facing = {"left": "(-1, 0, 0)", "back": "(0, 1, 0)", "bottom": "(0, 0, -1)"}
    for name, normal in facing.items():
        assert found[name].facing() == normal and found[name].measure == pytest.approx(1.0)
    assert groups_of(comm, "annulus", h=0.3)["inner"].facing() == "all ways (closed)"
    quarter = groups_of(comm, "annulus", h=0.1, quarter=True)
    assert quarter["outer"].facing() == "(0.637, 0.637) (curved)"  # 2/pi


@pytest.mark.serial
@pytest.mark.parametrize("cut", [0.3, 0.7, 0.97])
@pytest.mark.parametrize("version", ["2.2", "4.1"])
def test_a_file_without_its_end_is_refused(version: str, cut: float, tmp_path: Path) -> None:
    path = tmp_path / "body.msh"
    if version == "2.2":
        write_msh(path, *side_by_side(4, 4, gap=0.1))
    else:
        write(BUILDERS["block"](h=0.25), path)
    text = path.read_text()
    path.write_text(text[: int(cut * len(text))])
    with pytest.raises(InputError, match=r"body\.msh") as caught:
        from_file(path, MPI.COMM_SELF)
    assert caught.value.key == "mesh.file"
