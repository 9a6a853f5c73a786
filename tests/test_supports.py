"""Supports along the normal of the boundary or along a given direction."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from mpi4py import MPI
from problems import block

from contact_locking import InputError, checkpoint, save, solve_steps
from contact_locking.parameters import Parameters
from contact_locking.problem.assembly import Problem, assemble, mesh_of
from contact_locking.results.solution import Solution
from contact_locking.solving import solve_assembled
from contact_locking.study_file import from_mapping

Array = npt.NDArray[np.float64]

# The displacement into the body that the rollers prescribe.
MOVED = 0.002
SIDES = ("left", "top")
SERIAL = pytest.mark.serial


def turn(dim: int) -> Array:
    """A rotation that moves every axis."""
    cosine, sine = math.cos(0.4), math.sin(0.4)
    plane = np.array([[cosine, -sine], [sine, cosine]])
    if dim == 2:
        return plane
    about_z, about_x = np.eye(3), np.eye(3)
    about_z[:2, :2] = about_x[1:, 1:] = plane
    return about_x @ about_z


def vector(values: Array) -> list[float]:
    return [float(value) for value in values]


def holds(solution: Solution) -> bool:
    """Whether every criterion of the certificate holds."""
    criteria = solution.summary["certificate"]["criteria"]
    return all(criterion["holds"] for criterion in criteria.values())


def rollers(dim: int, rotation: Array, along: str) -> dict[str, Any]:
    """The sides left, and front in 3D, move by MOVED into the body and slide freely."""
    sides = ["left", "front"][: dim - 1]
    held: list[dict[str, Any]]
    if along == "component":
        held = [
            {"on": side, "value": [MOVED if i == axis else None for i in range(dim)]}
            for axis, side in enumerate(sides)
        ]
        return {"displacements": held}
    if along == "normal":
        return {"supports": [{"on": side, "along": "normal", "value": -MOVED} for side in sides]}
    # The length of a direction does not matter.
    held = [
        {"on": side, "along": vector(2.0 * rotation[:, axis]), "value": MOVED}
        for axis, side in enumerate(sides)
    ]
    return {"supports": held}


def turned(parameters: Parameters, rotation: Array) -> Problem:
    """The problem on the mesh of the parameters after a rotation about the origin."""
    domain = mesh_of(parameters, MPI.COMM_WORLD)
    x = domain.mesh.geometry.x
    x[:, : len(rotation)] = x[:, : len(rotation)] @ rotation.T
    return assemble(parameters, MPI.COMM_WORLD, domain)


def pressed(dim: int, rotation: Array, along: str, **changes: Any) -> Parameters:
    """A block on rollers, pulled along and pressed onto a foundation with friction."""
    pull = np.array([0.03, *[0.01] * (dim - 2), -0.05])
    given: dict[str, Any] = {
        "mesh__structured": True,
        "loads": {
            "tractions": [{"on": "top", "value": vector(rotation @ pull)}],
            **rollers(dim, rotation, along),
        },
        "friction__smoothing": {"kernel": "convolution", "radius": 0.6},
    }
    return block(dim, 0.5, **(given | changes))


def solved(dim: int, rotation: Array, along: str, **changes: Any) -> Solution:
    solution = solve_assembled(turned(pressed(dim, rotation, along, **changes), rotation))
    assert solution.converged, solution.summary["reason"]
    return solution


def nodal(solution: Solution) -> Array:
    """The displacements (k, d) of the local nodes."""
    return np.asarray(solution.displacement.x.array.reshape(-1, solution.domain.dim))


def differ(found: Array, wanted: Array) -> float:
    """The largest difference of local values relative to the largest value."""
    comm = MPI.COMM_WORLD
    most = comm.allreduce(float(np.abs(wanted).max(initial=0.0)), op=MPI.MAX)
    return comm.allreduce(float(np.abs(found - wanted).max(initial=0.0)), op=MPI.MAX) / most


# Rotations ----------------------------------------------------------------------------------------


@functools.cache
def unturned(dim: int, degree: int, n: float) -> Solution:
    """The block on rollers that fix components."""
    return solved(dim, np.eye(dim), "component", **sharp(degree, n))


def sharp(degree: int, n: float) -> dict[str, Any]:
    """Two solutions to the default tolerance of 1e-8 may differ by more than the test allows."""
    discretisation = {"degree": degree}
    return {"penalty__n": n, "discretisation": discretisation, "solver__tolerance": 1e-10}


@pytest.mark.parametrize(
    ("dim", "degree", "n", "along"),
    [
        (2, 1, math.inf, "given"),
        (2, 1, 1e3, "normal"),
        pytest.param(2, 1, math.inf, "normal", marks=SERIAL),
        pytest.param(2, 1, 1e3, "given", marks=SERIAL),
        pytest.param(2, 2, math.inf, "given", marks=SERIAL),
        pytest.param(2, 2, 1e3, "normal", marks=SERIAL),
        pytest.param(3, 1, math.inf, "given", marks=SERIAL),
        pytest.param(3, 1, 1e3, "normal", marks=SERIAL),
    ],
)
def test_oblique_rollers_of_a_turned_block_are_the_rollers_of_the_block(
    dim: int, degree: int, n: float, along: str
) -> None:
    rotation = turn(dim)
    wanted = unturned(dim, degree, n)
    found = solved(dim, rotation, along, **sharp(degree, n))
    assert differ(nodal(found) @ rotation, nodal(wanted)) < 1e-9
    reactions = found.summary["reactions"]
    assert set(reactions) == set(wanted.summary["reactions"])
    for name, force in wanted.summary["reactions"].items():
        assert np.array(reactions[name]) @ rotation == pytest.approx(np.array(force), abs=1e-9)
    assert holds(found)
    assert holds(wanted)


@pytest.mark.serial
@pytest.mark.parametrize("along", ["given", "normal"])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_support_along_an_axis_is_the_condition_for_the_component(dim: int, along: str) -> None:
    wanted = unturned(dim, 1, math.inf)
    found = solved(dim, np.eye(dim), along, **sharp(1, math.inf))
    assert np.array_equal(nodal(found), nodal(wanted))
    assert found.summary["reactions"] == wanted.summary["reactions"]


@pytest.mark.serial
@pytest.mark.parametrize(
    "solver",
    [{"method": "newton"}, {"linear": "iterative", "tolerance": 1e-10}, {"friction": "nested"}],
)
def test_every_solver_keeps_the_held_directions(solver: dict[str, Any]) -> None:
    rotation = turn(2)
    found, wanted = solved(2, rotation, "given", solver=solver), unturned(2, 1, 1e3)
    assert differ(nodal(found) @ rotation, nodal(wanted)) < 1e-6
    normal = rotation[:, 0]
    points = found.displacement.function_space.tabulate_dof_coordinates()[:, :2]
    left = np.abs(points @ normal) < 1e-9
    assert left.sum() == 3
    assert np.allclose((nodal(found) @ normal)[left], MOVED, rtol=0, atol=1e-15)


@pytest.mark.serial
def test_bounds_and_constants_do_not_depend_on_the_position() -> None:
    def certificate(rotation: Array, along: str) -> Any:
        # Without moved supports the theory gives bounds; the top holds the rest.
        eye = rotation.T
        supports = [{"on": side, "along": vector(eye[i])} for i, side in enumerate(SIDES)]
        values = [{"on": "left", "value": [0.0, None]}, {"on": "top", "value": [None, 0.0]}]
        held: dict[str, Any] = (
            {"displacements": values} if along == "component" else {"supports": supports}
        )
        loads = {"body_force": vector(rotation @ np.array([0.01, -0.05])), **held}
        return solved(2, rotation, along, loads=loads, penalty__n=math.inf).summary["certificate"]

    wanted, found = certificate(np.eye(2), "component"), certificate(turn(2), "given")
    assert found["constants"]["c_0"] == pytest.approx(wanted["constants"]["c_0"], rel=1e-5)
    for name, bound in wanted["bounds"].items():
        assert bound["bound"] is not None
        assert found["bounds"][name]["bound"] == pytest.approx(bound["bound"], rel=1e-6)


@pytest.mark.serial
def test_a_proof_that_nothing_is_admissible_does_not_depend_on_the_position() -> None:
    def factor(rotation: Array, along: str) -> list[float]:
        loads = rollers(2, rotation, along)
        across: dict[str, Any] = {"on": "right", "along": vector(rotation[:, 0]), "value": 0.1}
        foot: dict[str, Any] = {"on": "top", "along": vector(rotation[:, 1])}
        if along == "component":
            right = {"on": "right", "value": [0.1, None]}
            loads["displacements"] += [right, {"on": "top", "value": [None, 0.0]}]
        else:
            loads["supports"] += [across, foot]
        given = pressed(2, rotation, along, loads=loads, penalty__n=math.inf)
        summary = solve_assembled(turned(given, rotation)).summary
        assert not summary["converged"]
        return list(summary["admissible_load_factor"])

    assert factor(turn(2), "given") == pytest.approx(factor(np.eye(2), "component"), rel=1e-4)


@pytest.mark.serial
@pytest.mark.parametrize("young", [1e-9, 1.0, 2.1e11])
def test_units_do_not_matter_where_a_node_on_an_oblique_roller_sticks(young: float) -> None:
    """The corners on the left stick to the floor and to the tool, with one direction left free."""
    floor = {"on": "bottom", "foundation": {"half_space": {"point": [0, 0], "normal": [0, 1]}}}
    above: dict[str, Any] = {"half_space": {"point": [0, 1], "normal": [0, -1]}}
    push = {"on": "top", "foundation": {**above, "force": [0.0, -0.01 * young]}}
    given = block(
        2,
        0.5,
        mesh__structured=True,
        material={"elasticity": {"young": young, "poisson": 0.3}, "locking_limit": 0.5},
        loads={"supports": [{"on": "left", "along": [1, 0.2]}]},
        contact=[floor, push],
        friction={"coefficient": 0.2, "smoothing": {"kernel": "none"}},
        penalty__n=math.inf,
    )
    solution = solve_assembled(assemble(given, MPI.COMM_WORLD))
    assert solution.converged, solution.summary["reason"]
    assert holds(solution)
    assert solution.summary["contacts"][1]["tool"]["travel"] == pytest.approx(0.0084, rel=0.1)
    assert solution.summary["iterations"]["tangents"] <= 14


# Curved boundaries --------------------------------------------------------------------------------


def sector(n: float, **changes: Any) -> Parameters:
    """A sector of 60 degrees of a ring between the radii 1 and 2, see :func:`bent`."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 1.0], "h": 0.125, "structured": True},
        "material": {
            "elasticity": {"young": 1.0, "poisson": 0.3},
            "locking_limit": changes.pop("limit", math.inf),
        },
        "loads": {
            "supports": [
                {"on": "bottom", "along": [0, 1]},
                {"on": "top", "along": "normal"},
                {"on": "right", "along": "normal", "value": 0.01},
            ]
        },
        "contact": [],
        "penalty": {"n": n},
        **changes,
    }
    return Parameters.model_validate(data)


def bent(parameters: Parameters) -> Problem:
    """The problem with the unit block bent to the sector: x + 1 is the radius."""
    domain = mesh_of(parameters, MPI.COMM_WORLD)
    x = domain.mesh.geometry.x
    radius, angle = 1.0 + x[:, 0], x[:, 1] * math.pi / 3.0
    x[:, 0], x[:, 1] = radius * np.cos(angle), radius * np.sin(angle)
    return assemble(parameters, MPI.COMM_WORLD, domain)


@pytest.mark.parametrize("n", [pytest.param(1e4, marks=SERIAL), math.inf])
def test_a_sector_pulled_along_its_normals_has_the_displacement_of_the_ring(n: float) -> None:
    solution = solve_assembled(bent(sector(n)))
    assert solution.converged
    assert holds(solution)
    points = solution.displacement.function_space.tabulate_dof_coordinates()[:, :2]
    radius = np.linalg.norm(points, axis=1, keepdims=True)
    # Plane strain: u_r = A r + B/r without traction at r = 1, so that B = A/(1 - 2 nu).
    ratio = 1.0 / (1.0 - 2.0 * 0.3)
    size = 0.01 / (2.0 + ratio / 2.0)
    exact = size * (radius + ratio / radius) * points / radius
    assert differ(nodal(solution), exact) < 0.02
    side = np.abs(points[:, 1] - math.sqrt(3.0) * points[:, 0]) < 1e-9
    normal = np.array([-math.sqrt(3.0), 1.0]) / 2.0
    assert np.abs(nodal(solution)[side] @ normal).max(initial=0.0) < 1e-15


@pytest.mark.serial
def test_the_reactions_of_a_sector_balance() -> None:
    summary = solve_assembled(bent(sector(math.inf))).summary
    total = np.sum(list(summary["reactions"].values()), axis=0)
    assert set(summary["reactions"]) == {"bottom", "top", "right"}
    assert np.abs(total).max() < 1e-9
    # No part of the boundary has friction: the bottom pushes along y only.
    assert summary["reactions"]["bottom"][0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.serial
def test_a_locked_sector_keeps_the_limit() -> None:
    solution = solve_assembled(bent(sector(math.inf, limit=0.008)))
    assert solution.converged, solution.summary["reason"]
    assert holds(solution)
    assert solution.summary["locked_fraction"] > 0.0


# Corners, times and restarts ----------------------------------------------------------------------


def corner(*supports: dict[str, Any], **more: Any) -> Parameters:
    """A unit square with supports and no contact."""
    loads = {"supports": list(supports), **more}
    return block(2, 0.5, mesh__structured=True, contact=[], loads=loads)


def test_two_directions_at_a_corner_are_both_prescribed() -> None:
    solution = solve_assembled(
        turned(
            corner(
                {"on": "left", "along": [1, 0.5], "value": 0.01},
                {"on": "bottom", "along": [-0.5, 1], "value": "0.02 + 0.01*x"},
                {"on": "right", "along": [1, 0.5], "value": 0.01},
            ),
            np.eye(2),
        )
    )
    assert solution.converged
    points = solution.displacement.function_space.tabulate_dof_coordinates()
    at = np.linalg.norm(points, axis=1) < 1e-12
    first, second = np.array([1.0, 0.5]), np.array([-0.5, 1.0])
    wanted = (0.01 * first + 0.02 * second) / math.sqrt(1.25)
    assert np.allclose(nodal(solution)[at], wanted, rtol=0, atol=1e-16)


@pytest.mark.parametrize(
    ("supports", "displacements", "key", "words"),
    [
        (
            [{"on": "left", "along": [1, 1]}, {"on": "bottom", "along": [1, 1], "value": 0.1}],
            [],
            "loads.supports.0",
            "another value for the same direction at x = 0, y = ",
        ),
        (
            [{"on": "left", "along": [0, 2], "value": 0.1}],
            [{"on": "bottom", "value": [0, 0]}],
            "loads.supports.0",
            "another value",
        ),
        (
            [{"on": "left", "along": [1, 1], "value": 0.1}],
            [{"on": "bottom", "value": [0, 0]}],
            "loads.supports.0",
            "another value",
        ),
        (
            [{"on": "left", "along": [1, 1]}, {"on": "bottom", "along": [1, 1.001]}],
            [],
            "loads.supports.1",
            "almost",
        ),
        ([{"on": ["left", "bottom"], "along": "normal"}], [], "loads.supports.0.along", "an edge"),
        ([{"on": ["left", "right"], "along": [1, 1]}], [], "loads.displacements", "translation"),
    ],
)
def test_supports_that_contradict_each_other_are_refused(
    supports: list[dict[str, Any]], displacements: list[dict[str, Any]], key: str, words: str
) -> None:
    with pytest.raises(InputError, match=words) as caught:
        assemble(corner(*supports, displacements=displacements), MPI.COMM_WORLD)
    assert caught.value.key == key


@pytest.mark.serial
@pytest.mark.parametrize(
    ("support", "key", "words"),
    [
        ({"on": "roof", "along": "normal"}, "loads.supports.0.on", "no part of the boundary"),
        ({"on": "top", "along": [0, 0]}, "loads.supports.0.along", "must not be zero"),
        ({"on": "top", "along": [0, 0, 1]}, "loads.supports.0.along", "2 components"),
        ({"on": "top", "along": "tangent"}, "loads.supports.0.along", "must be normal or a list"),
        ({"on": "top", "along": [0, "x"]}, "loads.supports.0.along", "finite number"),
        ({"on": "top", "along": [0, 1], "value": "t"}, "loads.supports.0.value", "has no steps"),
        ({"on": "bottom", "along": [1, 1]}, "loads.supports.0.on", "must not overlap"),
    ],
)
def test_a_wrong_support_is_refused_with_its_key(
    support: dict[str, Any], key: str, words: str
) -> None:
    given = {
        "mesh": {"builder": "block"},
        "loads": {"supports": [support]},
        "contact": {"on": "bottom"},
    }
    with pytest.raises(InputError, match=words) as caught:
        from_mapping(given)
    assert key in str(caught.value)


@pytest.mark.serial
def test_a_body_that_its_normals_leave_free_to_turn_is_refused() -> None:
    supports = [{"on": ["contact", "side"], "along": "normal"}]
    given = {
        "mesh": {"builder": "disc", "h": 0.25, "half": False},
        "loads": {"supports": supports},
        "contact": [],
    }
    with pytest.raises(InputError, match="rotation"):
        assemble(from_mapping(given), MPI.COMM_WORLD)


@pytest.mark.serial
def test_a_support_follows_the_time_of_the_steps() -> None:
    held = [
        {"on": "left", "along": [1, 1]},
        {"on": "bottom", "along": [1, -1]},
        {"on": "right", "along": [1, 1], "value": "0.01*t"},
    ]
    loads, steps = {"supports": held}, {"times": [0.5, 1]}
    given = block(2, 0.5, mesh__structured=True, contact=[], loads=loads, steps=steps)
    sizes = [np.abs(nodal(item)).max(initial=0.0) for item in solve_steps(given)]
    sizes = [MPI.COMM_WORLD.allreduce(float(size), op=MPI.MAX) for size in sizes]
    assert sizes[1] == pytest.approx(2.0 * sizes[0], rel=1e-9)


@pytest.mark.skipif(checkpoint.unavailable() is not None, reason=str(checkpoint.unavailable()))
def test_a_restart_finds_the_same_state(comm: MPI.Intracomm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path)
    parameters = corner(
        {"on": "left", "along": [1, 1], "value": 0.001},
        {"on": "bottom", "along": [1, -1]},
        tractions=[{"on": "right", "value": [0.01, 0.0]}],
    )
    first = solve_assembled(assemble(parameters, comm))
    save(first, folder)
    again = solve_assembled(assemble(parameters, comm), restart=folder)
    assert differ(nodal(again), nodal(first)) < 1e-15
    assert again.summary["iterations"]["tangents"] == 0


@pytest.mark.serial
def test_a_guaranteed_bound_is_not_given_where_a_direction_is_held() -> None:
    given = pressed(2, turn(2), "given", certificate__error_bound=True, penalty__n=math.inf)
    errors = solve_assembled(turned(given, turn(2))).summary["certificate"]["errors"]
    assert not errors["guaranteed"]["applicable"]
    assert "no axis" in errors["guaranteed"]["reason"]
