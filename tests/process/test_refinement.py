"""Marking and refinement: what is refined, and what a finer mesh keeps of the coarse one."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotRefined
from contact_locking.mesh.checks import CellFacets, checked
from contact_locking.mesh.data import longest_edges, signed_measures
from contact_locking.mesh.parts import groups
from contact_locking.mesh.sources import WholeMesh, from_geometry, gather_cells, gather_mesh, spread
from contact_locking.meshes import BUILDERS, Geometry
from contact_locking.meshes.geometry import Curved
from contact_locking.process.adaptive_meshes import marked_cells, refined

SIZES = st.floats(0.0, 1e6) | st.just(0.0)
BODIES: dict[str, tuple[str, dict[str, Any]]] = {
    "block": ("block", {"h": 0.5}),
    "structured block": ("block", {"h": 0.5, "structured": True}),
    "punch": ("punch", {"h": 0.25}),
    "l_shape": ("l_shape", {"h": 0.5}),
    "block 3D": ("block", {"dim": 3, "h": 0.6}),
    "inclusion": ("inclusion", {"h": 0.2}),
    "disc": ("disc", {"h": 0.25}),
    "quarter disc": ("disc", {"h": 0.25, "quarter": True}),
    "annulus": ("annulus", {"h": 0.5}),
    "ball": ("ball", {"h": 0.25, "quarter": True}),
    "inclusion 3D": ("inclusion", {"dim": 3, "h": 0.2}),
}
CURVED = ("inclusion", "disc", "quarter disc", "annulus", "ball", "inclusion 3D")


@given(squares=st.lists(SIZES, max_size=30), share=st.floats(0.01, 1.0))
def test_marked_cells_have_the_share_and_no_smaller_set_has_it(
    squares: list[float], share: float
) -> None:
    eta = np.array(squares)
    marked = marked_cells(eta, share)
    if eta.sum() == 0.0:
        assert not marked.any()
        return
    assert eta[marked].sum() >= share * eta.sum() * (1.0 - 1e-12)
    # Without the cells that equal the smallest one, the share is missed.
    smallest = eta[marked].min()
    rest = eta[marked & (eta > smallest * (1.0 + 2e-6))]
    assert rest.sum() < share * eta.sum() or share == 1.0
    assert eta[~marked].max(initial=0.0) <= smallest


def made(name: str) -> tuple[Geometry, WholeMesh]:
    builder, changes = BODIES[name]
    geometry = BUILDERS[builder](**changes)
    mesh = gather_mesh(from_geometry(geometry, MPI.COMM_SELF))
    assert mesh is not None
    return geometry, mesh


def near(mesh: WholeMesh, place: FloatArray, share: float = 0.2) -> Any:
    """A mask of the cells nearest to a place."""
    middle = mesh.data.points[mesh.data.cells.nodes].mean(axis=1)
    distance = np.linalg.norm(middle - place, axis=1)
    return distance <= np.quantile(distance, share)


def measures(mesh: WholeMesh) -> dict[str, float]:
    return {group.name: group.measure for group in groups(spread(mesh, MPI.COMM_SELF))}


@pytest.mark.serial
@pytest.mark.parametrize("name", [name for name in BODIES if name not in CURVED])
def test_a_finer_mesh_of_a_straight_body_has_the_same_groups_with_the_same_measures(
    name: str,
) -> None:
    geometry, mesh = made(name)
    before, count = measures(mesh), len(mesh.data.cells)
    for _ in range(4):
        mesh = refined(mesh, near(mesh, mesh.data.points.min(axis=0)), geometry.curved)
    assert len(mesh.data.cells) > 2 * count
    assert measures(mesh) == pytest.approx(before, rel=1e-12)


@pytest.mark.serial
@pytest.mark.parametrize("name", BODIES)
def test_a_finer_mesh_is_the_mesh_of_a_body_without_flat_cells(name: str) -> None:
    geometry, mesh = made(name)

    def flattest(found: WholeMesh) -> float:
        points, cells = found.data.points, found.data.cells.nodes
        longest = longest_edges(points, cells) ** found.data.dim
        return float(np.min(np.abs(signed_measures(points, cells)) / longest))

    first = flattest(mesh)
    names = set(measures(mesh))
    rounds = 6 if mesh.data.dim == 2 else 4
    for _ in range(rounds):
        mesh = refined(mesh, near(mesh, mesh.data.points[0], 0.05), geometry.curved)
    found = checked(mesh.data)
    assert not found.findings and not found.unusable
    assert CellFacets(found).parts[0] == 1 and set(measures(mesh)) == names
    # Longest edges are bisected: in 2D no angle is less than half of the smallest one.
    assert flattest(mesh) > 0.2 * first


@pytest.mark.serial
@pytest.mark.parametrize("name", CURVED)
def test_new_nodes_lie_on_the_curved_sides(name: str) -> None:
    geometry, mesh = made(name)
    finer = mesh
    for _ in range(2 if mesh.data.dim == 2 else 1):
        finer = refined(finer, np.ones(len(finer.data.cells), dtype=bool), geometry.curved)
    for curve in geometry.curved:
        _check_nodes(finer, curve)
    if name.startswith("inclusion"):
        volume, exact = "inclusion", math.pi * 0.25**2 * (4 / 3 * 0.25 if "3D" in name else 1.0)
    else:
        volume, exact = "body", geometry.measure
    coarse, fine = (abs(measures(one)[volume] - exact) for one in (mesh, finer))
    # The error of a polygon is of second order; Gmsh's first mesh may have sides of two lengths.
    assert fine < (0.1 if mesh.data.dim == 2 else 0.4) * coarse


def _check_nodes(mesh: WholeMesh, curve: Curved) -> None:
    points, masks = mesh.data.points, []
    for name in curve.groups:
        mask = np.zeros(len(points), dtype=bool)
        for group in (mesh.data.facets, mesh.data.cells):
            mask[group.nodes[group.named(name)]] = True
        masks.append(mask)
    nodes = np.all(masks, axis=0)
    distance = np.linalg.norm(points[nodes] - np.array(curve.centre), axis=1)
    assert nodes.sum() > 2 and distance == pytest.approx(curve.radius, rel=1e-8)


@pytest.mark.serial
def test_a_mesh_that_is_too_coarse_for_its_curved_side_is_not_refined() -> None:
    _, mesh = made("block")
    bend = (Curved(("bottom",), (0.5, -1.0), 1.4),)
    with pytest.raises(NotRefined, match=r"curved side.*mesh\.h"):
        for _ in range(2):
            mesh = refined(mesh, np.ones(len(mesh.data.cells), dtype=bool), bend)


def test_refined_mesh_does_not_depend_on_the_ranks(comm: MPI.Intracomm, tmp_path: Path) -> None:
    geometry = BUILDERS["inclusion"](h=0.2)
    worlds = []
    for world in (MPI.COMM_SELF, comm):
        domain = from_geometry(geometry, world)
        for _ in range(2):
            mesh = gather_mesh(domain)
            middle = np.arange(domain.num_cells, dtype=float)
            owned = domain.mesh.topology.index_map(2).size_local
            local = middle[np.asarray(domain.mesh.topology.original_cell_index[:owned])]
            order = gather_cells(domain, local)
            finer = None
            if mesh is not None and order is not None:
                assert np.array_equal(order, middle)
                finer = refined(mesh, order % 5 == 0, geometry.curved)
            domain = spread(finer, world)
        worlds.append((gather_mesh(domain), groups(domain)))
    (alone, own), (together, shared) = worlds
    assert {g.name: g.count for g in own} == {g.name: g.count for g in shared}
    assert [g.measure for g in own] == pytest.approx([g.measure for g in shared], rel=1e-13)
    assert (together is None) == (comm.rank > 0)
    if together is not None and alone is not None:
        assert np.array_equal(alone.data.points, together.data.points)
        assert np.array_equal(alone.data.cells.nodes, together.data.cells.nodes)
        assert np.array_equal(alone.data.facets.nodes, together.data.facets.nodes)
