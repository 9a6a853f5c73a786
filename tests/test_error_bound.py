"""The guaranteed bound of the error: never below the error, sharp, and silent where not proved."""

from __future__ import annotations

import math
from typing import Any

import basix
import numpy as np
import pytest
import sympy as sp
import ufl
from basix import CellType, ElementFamily
from certified import certificate
from dolfinx import fem
from manufactured import Manufactured, X, Y
from problems import block, column, with_changes
from random_errors import compared, random_block
from test_verification_annulus import LAME_LAMBDA, LAME_MU, annulus, exact_displacement

from contact_locking import solve_steps, solving
from contact_locking.arrays import FloatArray
from contact_locking.certificate.guaranteed.data_oscillation import korn_constants
from contact_locking.certificate.guaranteed.macro_element import macro_element
from contact_locking.parameters import Parameters
from contact_locking.plain_text import per_cent
from contact_locking.problem.spaces import P2
from contact_locking.results import in_words
from contact_locking.results.solution import Solution

#: A displacement that vanishes on all sides but the bottom, where its normal component vanishes.
BUBBLE = X * (1 - X) * (1 - Y)
WAVES = (BUBBLE * sp.sin(3 * X + Y) / 5, BUBBLE * Y * sp.exp(X) / 5)

#: The points of high degrees that keep the polynomials apart.
GLL = basix.LagrangeVariant.gll_warped


def bound(parameters: Parameters) -> dict[str, Any]:
    return dict(certificate(parameters)["errors"]["guaranteed"])


def benchmark(divisions: int, **changes: Any) -> Parameters:
    """The model case on the regular grid with the larger error, with a proved bound."""
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, -0.05]}],
        "displacements": [{"on": "right", "value": [0.0, 0.0]}],
    }
    changes = {"penalty__n": math.inf, "material__locking_limit": 0.05, "loads": loads} | changes
    return block(
        2, 1.0 / divisions, mesh__structured=True, certificate__error_bound=True, **changes
    )


# The stresses -------------------------------------------------------------------------------------


@pytest.mark.serial
@pytest.mark.parametrize(("degree", "free", "loads"), [(1, 9, 6), (2, 18, 18)])
def test_the_macro_element_has_the_stresses_of_c1_splines_and_balances_all_loads(
    degree: int, free: int, loads: int
) -> None:
    element = macro_element(degree)
    # The second derivatives of C1 splines of degree k + 2 on the split triangle.
    assert len(element.basis) == free
    assert len(element.lifts) == loads
    # A self-equilibrated traction does no work along translations and the rotation.
    total = element.moments[:, :, 0].sum(axis=1)
    assert np.abs(total).max() < 1e-12
    lifted = element.lift_moments[:, :, 0].sum(axis=1)
    # The divergence has one unit of mass at a point of a part of the area 1/6.
    mass = element.load_mass.sum(axis=0) / 6.0
    wanted = np.zeros((3, len(mass), 2, 2))
    wanted[:, :, [0, 1], [0, 1]] = mass[None, :, None]
    assert lifted == pytest.approx(wanted.reshape(-1, 2), abs=1e-12)


def korn_constant(corners: FloatArray, degree: int) -> float:
    """The largest ``|grad(v - r)|/|eps(v)|`` of the polynomials on a triangle, from eigenvalues."""
    element = basix.create_element(ElementFamily.P, CellType.triangle, degree, GLL)
    points, weights = basix.make_quadrature(CellType.triangle, 2 * degree)
    inverse = np.linalg.inv((corners[1:] - corners[0]).T)
    slopes = np.einsum("ji,jqn->qni", inverse, element.tabulate(1, points)[1:, :, :, 0])
    x, y = np.moveaxis(slopes, 2, 0)
    zero = np.zeros_like(x)
    # Each column is a field along x or along y.
    strains = [np.hstack(pair) for pair in ((x, zero), (zero, y), (y / 2**0.5, x / 2**0.5))]
    turn = np.hstack([-y, x]) / 2.0
    share = (weights / weights.sum())[:, None]
    turn -= np.sum(share * turn, axis=0)
    sizes, fields = np.linalg.eigh(sum(part.T @ (share * part) for part in strains))
    # The first three are the rigid motions.
    assert abs(sizes[2] / sizes[-1]) < 1e-12 < 1e-9 < sizes[3] / sizes[-1]
    fields = fields[:, 3:] / np.sqrt(sizes[3:])
    gram = fields.T @ turn.T @ (share * turn) @ fields
    return math.sqrt(1.0 + 2.0 * np.linalg.eigvalsh(gram)[-1])


@pytest.mark.serial
def test_korns_constant_of_a_triangle_is_not_below_that_of_polynomials() -> None:
    # From an equilateral triangle to needles with a flat or with a short side.
    apices = [(0.5, 0.75**0.5), (0.0, 1.0), (0.5, 0.05), (0.0, 0.05), (0.97, 0.05), (1.5, 0.1)]
    apices += list(np.random.default_rng(1).uniform([0.0, 0.1], 1.0, size=(12, 2)))
    triangles = np.array([[[0.0, 0.0], [1.0, 0.0], apex] for apex in apices])
    edges = triangles - np.roll(triangles, 1, axis=1)
    bounds = korn_constants(np.linalg.norm(edges, axis=2))
    for corners, upper in zip(triangles, bounds, strict=True):
        assert 0.5 * upper < korn_constant(corners, 6) < upper


# Never below the error ----------------------------------------------------------------------------


@pytest.mark.parametrize("pressure", [pytest.param(None, marks=pytest.mark.slow), (1 + X) / 10])
def test_the_bound_of_a_manufactured_solution_is_sharp_and_never_below_the_error(
    pressure: Any,
) -> None:
    # Body force and traction are no polynomials: what is not balanced adds an oscillation.
    exact = Manufactured(WAVES, pressure, pressure, n=math.inf, epsilon=0.0)
    before = math.inf
    for h in (0.125, 0.0625):
        solution = exact.solved(h, certificate__error_bound=True)
        found = solution.summary["certificate"]["errors"]["guaranteed"]
        effectivity = found["energy_norm"] / exact.errors(solution).energy
        assert 1.0 <= effectivity < min(1.2, before)
        before = effectivity
    assert before <= 1.05


def annulus_error(solution: Solution) -> float:
    """The energy norm of the error against the exact solution of V10; collective."""
    mesh = solution.domain.mesh
    eps = ufl.sym(ufl.grad(solution.displacement - exact_displacement(mesh)))
    energy = LAME_LAMBDA * ufl.tr(eps) ** 2 + 2.0 * LAME_MU * ufl.inner(eps, eps)
    return math.sqrt(mesh.comm.allreduce(fem.assemble_scalar(fem.form(energy * ufl.dx))))


@pytest.mark.serial
def test_v10_the_bound_covers_the_error_in_a_ring_that_locks() -> None:
    for h in (0.2, 0.1):
        solution = annulus(h, math.inf, certificate__error_bound=True)
        found = solution.summary["certificate"]["errors"]["guaranteed"]
        # The exact solution is that of the circles, the bound that of the polygon.
        assert 1.2 < found["energy_norm"] / annulus_error(solution) < 2.6


@pytest.mark.serial
@pytest.mark.parametrize("seed", range(2))
def test_the_bound_of_a_random_problem_is_not_below_the_distance_to_a_finer_mesh(
    seed: int,
) -> None:
    found = compared(random_block(seed), 4)
    assert found is not None and found.bound["applicable"]
    assert found.effectivity > 1.0


@pytest.mark.serial
def test_v6_the_bound_of_a_body_pressed_onto_a_parabola_is_not_below_the_error() -> None:
    # The control values of a parabola are those of the gap, which degree 2 meets exactly.
    press = {"displacements": [{"on": "top", "value": [0.0, -0.03]}]}
    given = block(
        2,
        0.25,
        mesh__structured=True,
        material__locking_limit=math.inf,
        contact={"on": "bottom", "gap": "(x - 0.5)**2/8"},
        loads=press,
        penalty__n=math.inf,
        discretisation={"degree": 2},
        certificate__error_bound=True,
    )
    found = compared(given, 4, P2)
    assert found is not None and found.bound["applicable"]
    assert 1.0 < found.effectivity < 2.5


@pytest.mark.slow
@pytest.mark.serial
def test_no_bound_of_200_random_problems_is_below_the_distance_to_a_finer_mesh() -> None:
    found = [compared(random_block(seed), 4) for seed in range(200)]
    solved = [item for item in found if item is not None and item.bound["applicable"]]
    assert len(solved) > 180
    assert min(item.effectivity for item in solved) > 1.0
    assert float(np.median([item.effectivity for item in solved])) < 2.0


# How sharp ----------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("divisions", [8, 16, 32])
def test_the_effectivity_on_the_block_is_at_most_three_and_a_half(divisions: int) -> None:
    found = compared(benchmark(divisions), 256 // divisions)
    assert found is not None
    assert 1.0 < found.effectivity < 3.5


@pytest.mark.parametrize("pressure", [0.01, 0.05])
def test_the_bound_of_a_column_that_is_exact_is_the_tolerance_of_the_solver(
    pressure: float,
) -> None:
    # Contact alone holds the column, elastic for the one pressure and locked for the other.
    found = bound(column(pressure=pressure, penalty={"n": math.inf}, certificate__error_bound=True))
    assert found["applicable"] and found["relative"] < 1e-3


@pytest.mark.serial
def test_the_bound_includes_the_distance_to_the_solution_without_penalties() -> None:
    found = bound(column(pressure=0.05, certificate__error_bound=True))
    k = 1.3461538461538463
    excess = (0.05 - k * 0.02) / (k + 2e3)
    assert found["energy_norm"] >= math.sqrt(k * 2.0) * excess


def test_the_bound_is_the_same_on_every_number_of_ranks() -> None:
    # Computed on one rank.
    assert bound(benchmark(6))["energy_norm"] == pytest.approx(0.0207347254, rel=1e-6)


# Not applicable -----------------------------------------------------------------------------------


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"contact__gap": "0.001*x*x"}, "the gap is not met between the nodes"),
        (
            {
                "contact": {
                    "on": "bottom",
                    "foundation": {"cylinder": {"centre": [0.5, -2.0], "radius": 2.0}},
                }
            },
            "the contact normal changes along a facet",
        ),
        (
            {"loads__displacements": [{"on": "left", "value": ["0.001*y*y", 0.0]}]},
            "prescribed displacements are not met between the nodes",
        ),
        (
            {"material": {"locking": [{"norm": "volume", "at_least": -0.01}]}},
            "other sets of strains than the ball",
        ),
        ({"mesh__dim": 3}, "not in three dimensions"),
    ],
)
def test_where_no_bound_is_proved_the_reason_is_said(changes: dict[str, Any], why: str) -> None:
    dim = changes.pop("mesh__dim", 2)
    given = block(dim, 0.25 if dim == 2 else 0.5, certificate__error_bound=True, **changes)
    found = bound(given)
    assert found["energy_norm"] is None and found["applicable"] is False
    assert found["reason"].startswith("not applicable: ") and why in found["reason"]


@pytest.mark.serial
def test_no_bound_is_proved_where_friction_counts_the_slip_from_an_earlier_step() -> None:
    pull = {"tractions": [{"on": "top", "value": ["0.03*t", "-0.05*t"]}]}
    held = {"displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    process = {"loads": pull | held, "steps": {"to": 1.0, "count": 2}}
    given = benchmark(4, **process)
    first, second = (
        solution.summary["certificate"]["errors"]["guaranteed"] for solution in solve_steps(given)
    )
    # The first step starts from rest, as a static load does.
    assert first["applicable"] is True
    assert second["applicable"] is False and second["energy_norm"] is None
    assert second["reason"] == ("not applicable: friction counts the slip from an earlier step")


@pytest.mark.serial
def test_a_study_that_does_not_ask_has_no_guaranteed_bound() -> None:
    assert "guaranteed" not in certificate(block(h=0.5))["errors"]


@pytest.mark.serial
def test_the_command_line_shows_the_bound_in_one_row() -> None:
    solution = solving.solve(benchmark(4))
    rows = dict(in_words.rows(solution.summary, in_words.UseOfLimit(1.0, False)))
    relative = solution.summary["certificate"]["errors"]["guaranteed"]["relative"]
    assert rows["proved"].startswith(f"the whole error is at most {per_cent(relative)}")


# The limit load -----------------------------------------------------------------------------------


def pulled_l_shape(h: float, move: float) -> Parameters:
    """An L-shape with a clamped top and a right side that moves up, without contact."""
    return with_changes(
        {
            "mesh": {"builder": "l_shape", "h": h},
            "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
            "loads": {
                "displacements": [
                    {"on": "top", "value": [0.0, 0.0]},
                    {"on": "right", "value": [0.0, move]},
                ]
            },
            "contact": {"on": []},
            "certificate": {"error_bound": True},
        }
    )


@pytest.mark.serial
def test_what_a_coarse_mesh_cannot_follow_is_not_said_to_be_impossible_for_the_body() -> None:
    coarse, fine = (solving.solve(pulled_l_shape(h, 0.03)).summary for h in (0.5, 0.25))
    assert not coarse["converged"] and "of this mesh" in coarse["reason"]
    assert fine["converged"]
    brackets = []
    for summary in (coarse, fine):
        found = summary["certificate"]["limit_load"]
        assert found["infeasible"] is False
        brackets.append(found["load_factor"])
    confirmed, excluded = np.transpose(brackets)
    # The bracket of either mesh is one of the body: no lower end exceeds an upper end.
    assert confirmed.max() < excluded.min()
    assert excluded[0] < 1.8 and excluded[1] < 1.5


def test_displacements_that_are_too_large_for_every_mesh_are_proved_so() -> None:
    summary = solving.solve(pulled_l_shape(0.25, 0.06)).summary
    found = summary["certificate"]["limit_load"]
    assert found["infeasible"] is True
    assert 0.4 < found["load_factor"][0] < found["load_factor"][1] < 0.75
    assert "on no mesh" in summary["reason"]


def test_the_limit_load_of_a_stretched_bar_is_exact() -> None:
    # |eps| = M for a stretch of M = 0.02 without lateral strain.
    sides = [{"on": ["bottom", "top"], "value": [None, 0.0]}]
    ends = [{"on": "left", "value": [0.0, None]}, {"on": "right", "value": [0.03, None]}]
    stretched = block(
        h=0.5,
        loads={"displacements": sides + ends},
        contact={"on": []},
        penalty__n=math.inf,
        certificate__error_bound=True,
    )
    found = solving.solve(stretched).summary["certificate"]["limit_load"]
    assert found["infeasible"] is True
    assert found["load_factor"][1] == pytest.approx(2.0 / 3.0, rel=1e-6)


@pytest.mark.serial
def test_a_body_that_is_only_loaded_has_no_limit_load() -> None:
    assert "limit_load" not in certificate(benchmark(4))


@pytest.mark.serial
def test_displacements_that_nothing_resists_have_no_excluded_load_factor() -> None:
    shifted = block(
        h=0.5,
        loads={"displacements": [{"on": "left", "value": [0.001, 0.0]}]},
        contact={"on": []},
        penalty__n=math.inf,
        certificate__error_bound=True,
    )
    found = certificate(shifted)["limit_load"]
    assert found["load_factor"] == [1.0, None] and found["infeasible"] is False
