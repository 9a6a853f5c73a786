"""Two bodies, or the two sides of a cut, that touch each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved, with_changes
from small_meshes import Groups, grid, shared, side_by_side
from two_bodies import YOUNG, fit, lame_pressure, stack

from contact_locking import StudySolution, solve
from contact_locking.errors import InputError
from contact_locking.solver.ksp import FILTER_LIMIT
from contact_locking.study_file.parameters import Parameters

pytest.importorskip("gmsh")

DIRECT_OR_NOT = ("direct", "iterative")


def largest(solution: StudySolution, values: Any) -> float:
    return float(solution.domain.comm.allreduce(np.abs(values).max(initial=0.0), op=MPI.MAX))


def test_action_is_reaction_and_every_body_is_in_equilibrium() -> None:
    solution = solved(
        stack(
            2,
            0.2,
            loads__tractions=[{"on": "top", "value": [0.001, -0.01]}],
            friction__coefficient=0.3,
            mesh__upper=[0.6, 0.5],
        )
    )
    summary = solution.summary
    assert summary["certificate"]["resultants"]["contact"] == pytest.approx([0.0, 0.0], abs=1e-15)
    (contact,) = summary["contacts"]
    assert contact["against"] == ["lower_top"]
    # On the upper block, which nothing else holds.
    force = np.add(contact["contact_force"], contact["friction_force"])
    assert force == pytest.approx([-0.0006, 0.006], rel=1e-6)
    assert summary["reactions"]["bottom"] == pytest.approx([-0.0006, 0.006], rel=1e-6)


def test_friction_between_bodies_remembers_its_slip() -> None:
    """The upper block is pushed there and back, and dissipates what the slip takes."""
    solution = solved(
        stack(
            2,
            0.25,
            friction__coefficient=0.3,
            loads={
                "displacements": [
                    {"on": "bottom", "value": [0.0, 0.0]},
                    {"on": "top", "value": ["0.03*sin(pi*t)", -0.005]},
                ]
            },
            steps={"to": 1.5, "count": 6},
        )
    )
    history = solution.history.rows
    force = [row["friction_force_x"] for row in history]
    normal = [row["contact_force_y"] for row in history]
    # It slides to the right, sticks as it turns round, and slides back.
    slides = np.array([True, True, False, True, True, True])
    bound = 0.3 * np.abs(normal)
    assert np.abs(force)[slides] == pytest.approx(bound[slides], rel=1e-4)
    assert np.abs(force)[~slides] < 0.5 * bound[~slides]
    assert np.sign(force[1]) == -np.sign(force[-1])
    assert all(row["dissipated"] >= -1e-12 for row in history)
    assert sum(row["dissipated"] for row in history) > 5e-5


@pytest.mark.parametrize("sides", [("rim", "inner"), ("inner", "rim")])
def test_quadratic_rings_press_between_their_corners_as_well(sides: tuple[str, str]) -> None:
    """The middles of edges are on the circle, and not on its chords."""
    contact = {"on": sides[0], "against": sides[1], "gap": -0.01}
    solution = solved(fit(contact=contact, mesh__h=0.16, discretisation__degree=2))
    pressure = solution.contact_points.pressure if solution.contact_points else lame_pressure(0.01)
    assert pressure == pytest.approx(lame_pressure(0.01), rel=0.11)
    assert solution.summary["iterations"]["tangents"] <= 6


@pytest.mark.parametrize(("dim", "h", "degree"), [(2, 0.25, 2), (3, 0.5, 1)])
def test_the_pairing_of_bodies_that_stick_settles(dim: int, h: float, degree: int) -> None:
    """The jump between them is next to nothing, and no scale for their gaps."""
    given = stack(dim, h, friction__coefficient=0.5, discretisation__degree=degree)
    solution = solved(given)
    assert not solution.warnings
    assert solution.summary["iterations"]["tangents"] <= 12


def test_wrong_sides_are_refused_with_words() -> None:
    with pytest.raises(InputError, match=r"meet no facet of top that faces them"):
        solve(stack(contact={"on": "left", "against": "top"}))
    with pytest.raises(InputError, match=r"same and lower_top share the nodes of 4 facets, as at"):
        named = {"same": {"on": ["lower_top"]}}
        solve(stack(mesh__parts=named, contact={"on": "same", "against": "lower_top"}))
    # The outer side of the ring, which a ray from the disc meets from within, and the way back.
    for on, against in (("rim", "outer"), ("outer", "rim")):
        told = rf"normals of {on} and {against} point the same way, as at x = .* inside of its body"
        with pytest.raises(InputError, match=told):
            solve(fit(contact={"on": on, "against": against}))
    boxes = {"mesh__cells": "box", "mesh__structured": True}
    with pytest.raises(InputError, match=r"of left, around x = 0, y = 0\.5, z = 0\.5, meet no"):
        solve(stack(3, 0.5, contact={"on": "left", "against": "top"}, **boxes))
    load = [{"on": "upper_left", "value": [0.01, 0.0]}]
    with pytest.raises(
        InputError, match=r"top and lower_top .* as at x = .*, y = 2: one side sees"
    ):
        solve(stack(contact={"on": "top", "against": "lower_top"}, loads__tractions=load))
    with pytest.raises(InputError, match=r"reaches 0\.4\d* deep into rim at x = .*; move the bod"):
        solve(fit(mesh__radius=1.4, contact={"on": "inner", "against": "rim"}))
    with pytest.raises(ValueError, match=r"'lower_top' is in on as well"):
        stack(contact={"on": ["lower_top", "left"], "against": "lower_top"})
    with pytest.raises(ValueError, match=r"leave out one of both"):
        half = {"half_space": {"point": [0, 0], "normal": [0, 1]}}
        stack(contact={"on": "upper_bottom", "against": "lower_top", "foundation": half})


def test_meshes_of_both_bodies_are_refined_where_they_touch() -> None:
    """At the corners of a punch that is narrower than the block below, on both sides."""
    given: dict[str, Any] = {
        "mesh__upper": [0.6, 0.6],
        "loads__tractions": [{"on": "top", "value": [0.001, -0.01]}],
        "friction__coefficient": 0.5,
    }
    solution = solved(stack(2, 0.25, **given, adapt={"tolerance": 0.06}))
    meshes = solution.summary["adapt"]["meshes"]
    errors = [one["estimate"] for one in meshes]
    assert len(meshes) > 3 and errors[-1] <= 0.06 < errors[0]
    # Of a uniform mesh with as many unknowns the error is larger.
    uniform = solved(stack(2, 0.045, **given))
    assert uniform.summary["dofs"] > solution.summary["dofs"]
    assert uniform.summary["certificate"]["errors"]["mesh"]["relative"] > 0.06
    domain = solution.domain
    owned = domain.mesh.topology.index_map(2).size_local
    x = domain.mesh.geometry.x[domain.mesh.geometry.dofmap[:owned]][:, :, :2]
    sizes = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1)
    at_corner = np.linalg.norm(x - [0.8, 1.0], axis=2).min(axis=1) < 0.1
    is_upper = x[:, :, 1].mean(axis=1) > 1.0
    for inside in (is_upper, ~is_upper):
        least = np.where(at_corner & inside, sizes, 1.0).min(initial=1.0)
        assert domain.comm.allreduce(least, op=MPI.MIN) < 0.05


def from_file(path: Path, contact: dict[str, Any], **changes: Any) -> Parameters:
    """A body from a mesh file, held on the left and pressed from the right."""
    data: dict[str, Any] = {
        "mesh": {"file": str(path)},
        "material": {"elasticity": {"young": YOUNG, "poisson": 0.0}},
        "loads": {
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
            "tractions": [{"on": "right", "value": [-0.01, 0.0]}],
        },
        "contact": contact,
        "friction": {"coefficient": 0.5, "smoothing": {"kernel": "none"}},
    }
    return with_changes(data, **changes)


def test_nodes_of_both_sides_may_be_at_one_place_in_a_file(tmp_path: Path) -> None:
    comm, n, m = MPI.COMM_WORLD, 4, 6
    points, groups = side_by_side(n, m)
    rest = len(grid(0, 0, 1, n)[0])
    groups["left"] = [(1 + j * (n + 1), 1 + (j + 1) * (n + 1)) for j in range(n)]
    groups["face"] = [((j + 1) * (n + 1), (j + 2) * (n + 1)) for j in range(n)]
    groups["back"] = [(rest + 1 + j * (m + 1), rest + 1 + (j + 1) * (m + 1)) for j in range(m)]
    groups["right"] = [(rest + (j + 1) * (m + 1), rest + (j + 2) * (m + 1)) for j in range(m)]
    path = shared(comm, tmp_path, points, groups)
    with pytest.raises(InputError, match="two parts of the body touch and share no nodes"):
        solve(from_file(path, {"on": []}))
    solution = solved(from_file(path, {"on": "back", "against": "face"}))
    stress = solution.elastic_stress.x.array.reshape(-1, 2, 2)
    assert largest(solution, stress - np.diag([-0.01, 0.0])) <= 1e-8


@pytest.mark.parametrize(
    ("limit", "cells"),
    [(None, "simplex"), (0, "simplex"), (0, "box")],
    ids=["filtered", "projected", "projected, hexahedra"],
)
def test_an_iterative_solver_knows_what_joins_two_bodies(
    limit: int | None, cells: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if limit is not None:
        monkeypatch.setitem(FILTER_LIMIT, (3, 1), limit)
    given: dict[str, Any] = {"friction__coefficient": 0.3, "material__locking_limit": 0.006}
    given |= {"mesh__cells": cells, "mesh__structured": cells == "box"}
    found = [solved(stack(3, 0.4, **given, solver__linear=name)) for name in DIRECT_OR_NOT]
    energies = [one.summary["elastic_energy"] for one in found]
    assert energies[0] == pytest.approx(energies[1], rel=1e-7)
    # As with a foundation: a filter that forgets a side takes some 200 for each tangent.
    counts = found[1].summary["iterations"]
    assert counts["linear"] <= 30 * counts["tangents"]


def test_two_locking_blocks_that_are_squeezed_too_far_are_proved_to_be() -> None:
    """Blocks of height 1 and strains of 0.005 at most give way by 0.01."""
    held = [{"on": "bottom", "value": [0.0, 0.0]}, {"on": "top", "value": [0.0, -0.05]}]
    solution = solve(stack(2, 0.25, material__locking_limit=0.005, loads={"displacements": held}))
    assert not solution.converged and "infeasible" in solution.summary["reason"]
    assert "20 % of the prescribed displacements" in solution.summary["reason"]


def test_a_row_of_three_bodies_passes_the_force_on(tmp_path: Path) -> None:
    """Each body is held by the next alone; the body in the middle is side 1 and side 2."""
    points: Any = []
    groups: Groups = {}
    for number, n in enumerate((3, 5, 4)):
        first = len(points) + 1
        own, cells = grid(float(number), 0.0, first, n)
        points += own
        groups[f"body{number}"] = cells
        columns = {f"west{number}": first, f"east{number}": first + n}
        for name, start in columns.items():
            groups[name] = [(start + j * (n + 1), start + (j + 1) * (n + 1)) for j in range(n)]
    # Forces along the axes are those of the undeformed frame.
    pairs = [(f"east{i}", f"west{i + 1}") for i in range(2)]
    contact = [{"on": on, "against": against, "pair": "once"} for on, against in pairs]
    path = shared(MPI.COMM_WORLD, tmp_path, points, groups)
    loads = {
        "displacements": [{"on": "west0", "value": [0.0, 0.0]}],
        "tractions": [{"on": "east2", "value": [-0.01, 0.002]}],
    }
    given = from_file(path, {"on": []}).model_dump() | {"contact": contact, "loads": loads}
    solution = solved(Parameters.model_validate(given))
    for part in solution.summary["contacts"]:
        assert part["contact_force"] == pytest.approx([-0.01, 0.0], abs=1e-9)
        assert part["friction_force"] == pytest.approx([0.0, 0.002], abs=1e-9)
