"""V13: the solution against Clarabel's of the same discrete problem at the same friction bound."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from problems import block, with_changes
from sweep.reference import of_solution
from verification_table import Rows

from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters

pytest.importorskip("clarabel")
pytestmark = pytest.mark.serial

REACH = 0.4
PUSH = [0.006, -0.018]
# With Clarabel's own tolerances of 1e-8 its energies are up to 5e-8 above the least.
TIGHT = {"tol_gap_rel": 1e-10, "tol_gap_abs": 1e-12, "tol_feas": 1e-11}


def half_disc() -> Parameters:
    """Pressed onto a plane and pushed along it, by displacements of its flat top."""
    data: dict[str, Any] = {
        "mesh": {"builder": "disc", "contact_width": REACH, "h": 0.1, "h_contact": 0.04},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
        "loads": {"displacements": [{"on": "top", "value": PUSH}]},
        "contact": {
            "on": "contact",
            "foundation": {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        },
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 0.1}},
        "penalty": {"n": math.inf},
    }
    return with_changes(data)


def assert_the_same(where: str, solution: StudySolution, found: Rows) -> None:
    """Energy to 8 digits and displacement to 1e-5, where something locks, sticks and slips."""
    summary, reference = solution.summary, of_solution(solution)
    u = reference.minimiser(**TIGHT)
    assert summary["converged"], summary["reason"]
    assert summary["locked_fraction"] > 0.1
    # The regularised law nears its bound slowly: nearly all of it counts as sticking.
    assert summary["contact_area"] > 1.1 * summary["slip_area"]
    assert summary["slip_area"] > 0.0 or reference.judge.epsilon > 0.0
    ours = solution.displacement.x.array
    pair = reference.energy(ours), reference.energy(u)
    found.add("V13", where, "energy beside Clarabel's", *pair)
    assert pair[0] == pytest.approx(pair[1], rel=1e-8)
    assert summary["elastic_energy"] == pytest.approx(0.5 * u @ (reference.stiffness @ u), rel=1e-6)
    distance = float(np.abs(ours - u).max() / np.abs(u).max())
    found.add("V13", where, "displacement beside Clarabel's", distance, None, abs=1e-5)


@pytest.mark.parametrize(("dim", "h"), [(2, 0.05), (3, 0.25)])
def test_v13_block_agrees_with_the_conic_solver(dim: int, h: float, found: Rows) -> None:
    solution = solving.solve(block(dim, h, penalty__n=math.inf))
    assert_the_same(f"block, {dim}D, n = inf", solution, found)


def test_v13_half_disc_agrees_with_the_conic_solver(found: Rows) -> None:
    solution = solving.solve(half_disc())
    assert_the_same("half disc, n = inf", solution, found)


@pytest.mark.parametrize("penalty", [{"n": math.inf}, {"n": 1e4, "epsilon": 1e-4}])
def test_v13_quadratic_block_agrees_with_the_conic_solver(
    penalty: dict[str, float], found: Rows
) -> None:
    solution = solving.solve(block(2, 0.125, penalty=penalty, discretisation={"degree": 2}))
    where = f"block, 2D, n = {penalty['n']:g}, P2, limit at vertices"
    assert_the_same(where, solution, found)


@pytest.mark.parametrize("method", ["interior_point", "penalty"])
def test_v13_penalised_block_agrees_with_the_conic_solver(method: str, found: Rows) -> None:
    penalty = {"n": 1e4, "epsilon": 1e-4}
    solution = solving.solve(block(penalty=penalty, solver={"method": method}))
    assert_the_same(f"block, n = 1e4, {method}", solution, found)
