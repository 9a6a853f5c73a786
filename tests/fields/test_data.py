"""The data a user can give: each way to say the same thing gives the same solution."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from problems import block, column, with_changes
from verification_table import Row

from contact_locking import study_file
from contact_locking.laws.elasticity import isotropic_stiffness, lame_from_young
from contact_locking.process import solving
from contact_locking.results.contact_points import SLIP
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters


def _solved(parameters: Parameters) -> StudySolution:
    solution = solving.solve(parameters)
    assert solution.converged, solution.summary["reason"]
    return solution


def _same(first: Parameters, second: Parameters, tolerance: float = 1e-8) -> None:
    a, b = _solved(first).summary, _solved(second).summary
    for key in ("compliance", "elastic_energy", "strain_norm_max", "locked_fraction"):
        assert a[key] == pytest.approx(b[key], rel=tolerance), key
    for key in ("contact_force", "friction_force"):
        assert a[key] == pytest.approx(b[key], rel=tolerance, abs=1e-9), key


LAME = lame_from_young(1.0, 0.3)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(
    "elasticity",
    [
        {"lambda": LAME[0], "mu": LAME[1]},
        {"young": "1 + 0*x", "poisson": "0.3"},
        "stiffness",
    ],
    ids=["lame", "expressions", "stiffness"],
)
def test_isotropic_elasticity_can_be_given_in_every_way(dim: int, elasticity: Any) -> None:
    h = 0.2 if dim == 2 else 0.5
    if elasticity == "stiffness":
        elasticity = {"stiffness": isotropic_stiffness(*LAME, dim).tolist()}
    _same(block(dim, h), block(dim, h, material__elasticity=elasticity))


def _inclusion(material: dict[str, Any]) -> Parameters:
    return block(mesh={"builder": "inclusion", "dim": 2, "h": 0.1}, material=material)


def test_a_region_and_an_expression_say_the_same() -> None:
    stiff = {"elasticity": {"young": 10.0, "poisson": 0.3}, "locking_limit": math.inf}
    soft = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02}
    inside = "(x - 0.5)**2 + (y - 0.5)**2 < 0.25**2"
    _same(
        _inclusion({**soft, "regions": {"inclusion": stiff}}),
        _inclusion(
            {
                "elasticity": {"young": f"10 if {inside} else 1", "poisson": 0.3},
                "locking_limit": f"inf if {inside} else 0.02",
            }
        ),
    )


def test_a_region_may_be_anisotropic_in_an_isotropic_body() -> None:
    matrix = isotropic_stiffness(*lame_from_young(10.0, 0.3), 2)
    region = {"elasticity": {"stiffness": matrix.tolist()}}
    isotropic = {"elasticity": {"young": 10.0, "poisson": 0.3}}
    soft = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02}
    _same(
        _inclusion({**soft, "regions": {"inclusion": region}}),
        _inclusion({**soft, "regions": {"inclusion": isotropic}}),
    )


def test_a_body_that_is_stiffer_along_its_fibres_strains_less_along_them() -> None:
    def sinks(stiffness: list[list[float]]) -> float:
        return _solved(column(2, 0.01, material={"elasticity": {"stiffness": stiffness}})).summary[
            "compliance"
        ]

    along = sinks([[1.0, 0.2, 0.0], [0.2, 4.0, 0.0], [0.0, 0.0, 1.0]])
    across = sinks([[4.0, 0.2, 0.0], [0.2, 1.0, 0.0], [0.0, 0.0, 1.0]])
    # Uniaxial strain: the top sinks by gap + p eps + H p/C_yy.
    assert along == pytest.approx(0.01 * (0.1 + 0.01 * 1e-4 + 2.0 * 0.01 / 4.0), rel=1e-8)
    assert across == pytest.approx(0.01 * (0.1 + 0.01 * 1e-4 + 2.0 * 0.01 / 1.0), rel=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_gap_can_be_a_number_an_expression_or_a_half_space(dim: int) -> None:
    h = 0.2 if dim == 2 else 0.5
    up = [0.0] * (dim - 1) + [1.0]
    below = [0.3] * (dim - 1) + [-0.005]
    plane = {"half_space": {"point": below, "normal": up}}
    number = block(dim, h, contact={"on": "bottom", "gap": 0.005})
    _same(number, block(dim, h, contact={"on": "bottom", "gap": "0.005 + 0*x"}))
    _same(number, block(dim, h, contact={"on": "bottom", "foundation": plane}))


@pytest.mark.parametrize(
    ("dim", "kind", "extra"),
    [
        (2, "sphere", {}),
        (2, "cylinder", {}),
        (3, "sphere", {}),
        (3, "cylinder", {"axis": [1, 0, 0]}),
    ],
)
def test_a_foundation_of_huge_radius_is_flat(dim: int, kind: str, extra: dict[str, Any]) -> None:
    radius = 1e7
    centre = [0.5] * (dim - 1) + [-radius - 0.005]
    body = {kind: {"centre": centre, "radius": radius, **extra}}
    h = 0.2 if dim == 2 else 0.5
    flat = block(dim, h, contact={"on": "bottom", "gap": 0.005})
    _same(flat, block(dim, h, contact={"on": "bottom", "foundation": body}), 1e-4)


def test_a_sphere_presses_where_it_is_highest() -> None:
    body = {"sphere": {"centre": [0.5, -1.0], "radius": 1.01}}
    held = [{"on": "top", "value": [0.0, 0.0]}]
    solution = _solved(
        block(
            h=0.05,
            contact={"on": "bottom", "foundation": body},
            loads={"displacements": held},
            material__locking_limit=math.inf,
        )
    )
    points = solution.contact_points
    assert solution.summary["contact_force"][1] > 0.0
    assert solution.summary["contact_force"][0] == pytest.approx(0.0, abs=1e-2 * 0.1)
    if points is not None:
        assert points.x[np.argmax(points.pressure), 0] == pytest.approx(0.5, abs=0.06)


def test_loads_of_several_parts_and_a_body_force_add_up_in_equilibrium() -> None:
    # Rollers left and right carry no vertical force, so contact carries all of it.
    loads = {
        "body_force": [0, "-0.01*(1 + y)"],
        "tractions": [
            {"on": "top", "value": [0, "-0.02*x"]},
            {"on": ["left", "right"], "value": [0, -0.005]},
        ],
        "displacements": [{"on": ["left", "right"], "value": [0, None]}],
    }
    solution = _solved(column(loads=loads, contact={"on": "bottom"}))
    # Column 1 x 2: body force 0.01 * (2 + 2), top 0.01, sides 2 * 2 * 0.005.
    expected = 0.01 * 4.0 + 0.01 + 0.02
    assert solution.summary["contact_force"][1] == pytest.approx(expected, rel=1e-8)


def test_prescribed_displacements_hold_component_by_component() -> None:
    moved = [
        {"on": "left", "value": [0.0, None]},
        {"on": "right", "value": ["0.01*(1 + y)", -0.002]},
    ]
    solution = _solved(block(loads={"displacements": moved}))
    u, ds = solution.displacement, solution.domain.ds
    x = ufl.SpatialCoordinate(solution.domain.mesh)
    left = u[0] ** 2 * ds(("left",))
    right = ((u[0] - 0.01 * (1 + x[1])) ** 2 + (u[1] + 0.002) ** 2) * ds(("right",))
    error = solution.domain.comm.allreduce(fem.assemble_scalar(fem.form(left + right)))
    assert error <= 1e-24
    assert solution.summary["bounds"]["displacement_norm"]["holds"] is None


def test_n_and_epsilon_are_independent() -> None:
    soft_contact = _solved(block(penalty={"n": 1e4, "epsilon": 1e-1})).summary
    soft_locking = _solved(block(penalty={"n": 1e1, "epsilon": 1e-4})).summary
    assert soft_contact["strain_norm_max"] < 0.0205 < soft_locking["strain_norm_max"]
    assert soft_contact["penetration_max"] > 10.0 * soft_locking["penetration_max"]


def test_coulombs_law_needs_no_regularisation_beside_penalties() -> None:
    """A regularisation of 0 is the limit of small ones."""
    found = [
        solving.solve(
            block(2, 0.25, friction__smoothing__radius=0.3, friction__regularisation=slip)
        )
        for slip in (0.0, 1e-9)
    ]
    exact, near = (solution.summary for solution in found)
    assert exact["converged"] and exact["penalty"]["regularisation"] == 0.0
    assert exact["friction_force"] == pytest.approx(near["friction_force"], rel=1e-5)


def test_contact_with_friction_but_without_locking_slides_against_the_pull() -> None:
    solution = _solved(
        block(
            material__locking_limit=math.inf,
            loads__tractions=[{"on": "top", "value": [0.05, -0.02]}],
            penalty__epsilon=1e-6,
        )
    )
    points = solution.contact_points
    if points is not None:
        slides = points.state == SLIP
        assert slides.any()
        traction = np.linalg.norm(points.traction[slides], axis=1)
        assert traction == pytest.approx(points.bound[slides], rel=0.01)
        assert np.all(np.sum(points.traction * points.u_tangent, axis=1)[slides] < 0.0)


def test_a_body_without_contact_is_an_elastic_locking_body() -> None:
    solution = _solved(block(contact={"on": []}))
    assert solution.contact_points is None or len(solution.contact_points) == 0
    assert solution.summary["contact_force"] == [0.0, 0.0]
    assert solution.summary["locked_fraction"] > 0.0


def test_bounds_of_the_paper_hold_and_are_tight_within_an_order() -> None:
    bounds = _solved(block()).summary["bounds"]
    penalties = {"locking_penalty", "contact_penalty"}
    assert set(bounds) == {"displacement_norm", "locking_work", *penalties}
    for entry in bounds.values():
        assert entry["holds"] is True
        assert 0.0 < entry["value"] <= entry["bound"]


def test_dual_norm_bound_is_attained_by_a_linear_body_without_contact() -> None:
    # With A = alpha I (lambda = 0) and nothing active, |u|_V = |f|_V/alpha.
    linear = with_changes(
        {
            "mesh": {"builder": "block", "h": 0.2},
            "material": {"elasticity": {"lambda": 0.0, "mu": 2.0}},
            "loads": {
                "body_force": [0.3, "x*y"],
                "displacements": [{"on": "left", "value": [0, 0]}],
            },
            "contact": {"on": []},
        }
    )
    bound = _solved(linear).summary["bounds"]["displacement_norm"]
    assert bound["value"] == pytest.approx(bound["bound"], rel=1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_v14_four_ranks_agree_with_one(tmp_path: Path, found: list[Row]) -> None:
    file = tmp_path / "block.yml"
    file.write_text(study_file.dump(block(h=0.1, penalty__n=math.inf)))
    run = [sys.executable, "-m", "contact_locking", "run", str(file), "--quiet"]
    summaries = []
    for ranks in (1, 4):
        output = tmp_path / str(ranks)
        launcher = ["mpirun", "-n", str(ranks)] if ranks > 1 else []
        subprocess.run([*launcher, *run, "--output", str(output)], check=True, timeout=240)
        summaries.append(json.loads((output / "summary.json").read_text()))
    one, four = summaries
    assert (one["ranks"], four["ranks"]) == (1, 4)
    for key in ("compliance", "elastic_energy", "strain_norm_max"):
        where = "block on four ranks beside one"
        found.append(Row("V14", where, key.replace("_", " "), four[key], one[key], "test_data.py"))
        assert four[key] == pytest.approx(one[key], rel=1e-8)
    assert four["contact_force"] == pytest.approx(one["contact_force"], rel=1e-8, abs=1e-12)
