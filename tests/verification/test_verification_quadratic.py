"""Quadratic elements on problems with known answers: computed beside exact."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from manufactured import rate
from mpi4py import MPI
from problems import block, column, with_changes
from test_verification import HALF_WIDTH as LINE_HALF_WIDTH
from test_verification import PEAK as LINE_PEAK
from test_verification import Foot, K, pressed_cylinder
from test_verification_annulus import annulus, errors
from test_verification_hertz import FORCE, HALF_WIDTH, PEAK, indented
from test_verification_manufactured import SIGNORINI, problem_of
from verification_table import Rows

from contact_locking.fem.spaces import P1, P2, Element
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.study_file.parameters import Parameters

#: The rates in V and in L2: of smooth solutions in the body and at contact, of friction by the
#: weights of the control values, and of locking by the weights of the vertices.
RATES = [
    ("contact", 2.0, 2.0),
    ("friction", 1.7, 1.8),
    ("locking", 1.0, 2.0),
    ("all together", 1.0, 2.0),
]


def solved(parameters: Parameters, element: Element, comm: MPI.Intracomm) -> StudySolution:
    solution = solving.solve_assembled(assemble(parameters, comm, element=element))
    assert solution.converged, solution.summary["reason"]
    return solution


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_v1_column_in_uniaxial_strain_is_exact(dim: int, found: Rows, comm: MPI.Intracomm) -> None:
    pressure, limit, n, epsilon = 0.05, 0.02, 1e3, 1e-4
    parameters = column(dim, pressure, penalty__n=n, penalty__epsilon=epsilon)
    solution = solved(parameters, P2, comm)
    summary = solution.summary
    exact = limit + (pressure - K * limit) / (K + 2.0 * n)
    assert summary["strain_norm_max"] == pytest.approx(exact, rel=1e-8)
    assert summary["penetration_max"] == pytest.approx(pressure * epsilon, rel=1e-8)
    assert summary["contact_force"][-1] == pytest.approx(pressure, rel=1e-8)
    if solution.contact_points is not None:
        assert solution.contact_points.pressure == pytest.approx(pressure, rel=1e-7)
    where = f"column, {dim}D, P2"
    found.add("V1", where, "strain", summary["strain_norm_max"], exact)


@pytest.mark.slow
@pytest.mark.serial
def test_v4_a_coarse_quadratic_mesh_has_the_peak_pressure_of_hertz(
    tmp_path: Path, found: Rows
) -> None:
    force, half_width, peak = indented(tmp_path, 1.0, 0.25, 0.04, degree=2)
    where = "indented unit block, P2 with facets of 0.04"
    found.add("V4", where, "force", force, FORCE)
    found.add("V4", where, "half-width", half_width, HALF_WIDTH, rel=0.13)
    found.add("V4", where, "peak pressure", peak, PEAK, rel=0.03)
    # The block is ten half-widths high on a fixed base, and a facet is 0.4 of a half-width.
    assert FORCE < force < 1.13 * FORCE


@pytest.mark.serial
def test_v6_quadratic_line_contact_of_hertz_needs_half_as_many_facets(found: Rows) -> None:
    solution = pressed_cylinder(0.1, degree=2)
    half, points = solution.summary["contact_area"] / 2, solution.contact_points
    assert points is not None
    peak = float(points.pressure.max())
    where = "cylinder on a plane, P2 with facets of 0.1"
    # The half-width counts whole points, which are 0.07 of it apart; beyond it lies one point on
    # each side, with 2 % of the peak.
    found.add("V6", where, "half-width", half, LINE_HALF_WIDTH, rel=0.07)
    found.add("V6", where, "peak pressure", peak, LINE_PEAK, rel=0.003)
    exact = LINE_PEAK * np.sqrt(np.maximum(1.0 - (points.x[:, 0] / LINE_HALF_WIDTH) ** 2, 0.0))
    inside = np.abs(points.x[:, 0]) < 0.7 * LINE_HALF_WIDTH
    error = np.sqrt(np.mean((points.pressure - exact)[inside] ** 2)) / LINE_PEAK
    found.add("V6", where, "error of the pressure within 0.7 a", error, None, abs=0.004)


@pytest.mark.slow
@pytest.mark.serial
def test_v10_the_annulus_converges_to_its_exact_solution(found: Rows) -> None:
    sizes = [1 / 5, 1 / 10, 1 / 20]
    both = [errors(annulus(h, math.inf, discretisation={"degree": 2})) for h in sizes]
    v, l2 = ([pair[i] for pair in both] for i in (0, 1))
    where = "annulus, n = inf, P2"
    found.add("V10", where, "rate in V, optimal", rate(sizes, v), 2.0)
    found.add("V10", where, "relative V error, h = 1/20", v[-1], None, abs=0.009)
    found.add("V10", where, "relative L2 error, h = 1/20", l2[-1], None)
    # The strain has a kink at the edge of the ring, and the sides are straight.
    assert rate(sizes, v) == pytest.approx(1.0, abs=0.15)
    assert rate(sizes, l2) == pytest.approx(2.0, abs=0.25)


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize(("name", "in_v", "in_l2"), RATES)
def test_v11_rates_of_quadratic_elements(name: str, in_v: float, in_l2: float, found: Rows) -> None:
    sizes = [1 / 4, 1 / 8, 1 / 16]
    given = dataclasses.replace(problem_of(name), element=P2)
    norms = [given.errors(given.solved(h)) for h in sizes]
    rates = rate(sizes, [e.v for e in norms]), rate(sizes, [e.l2 for e in norms])
    where = f"manufactured, 2D, P2: {name}"
    for norm, measured, expected in zip(("V", "L2"), rates, (2.0, 3.0), strict=True):
        found.add("V11", where, f"rate in {norm}, optimal", measured, expected)
    # The rate in L2 of contact and friction falls from mesh to mesh, from above.
    assert rates[0] == pytest.approx(in_v, abs=0.15)
    assert rates[1] >= in_l2 - 0.15


def signorini_error(h: float, epsilon: float) -> float:
    """The V error of V12, where the body touches for x < 2/3 and the gap has a kink at 2/3."""
    penalty = {"n": 1e4, "epsilon": epsilon} if epsilon > 0.0 else {"n": math.inf}
    given = dataclasses.replace(SIGNORINI, element=P2)
    return given.errors(given.solved(h, penalty=penalty)).v


@pytest.mark.slow
@pytest.mark.serial
def test_v12_error_in_v_is_of_the_order_of_epsilon_plus_h_squared(found: Rows) -> None:
    # 2/3 is a node of each mesh.  With a kink inside a facet the order is 1, as the gap of a facet
    # is quadratic.
    sizes = [1 / 6, 1 / 12, 1 / 24]
    for text, factor in (("0", 0.0), ("h^2/512", 1.0 / 512.0)):
        in_v = rate(sizes, [signorini_error(h, factor * h**2) for h in sizes])
        found.add("V12", f"Signorini, P2, eps = {text}", "rate in V", in_v, 2.0, abs=0.1)
    penalties = [1e-3, 2.5e-4, 6.25e-5]
    in_v = rate(penalties, [signorini_error(1 / 24, epsilon) for epsilon in penalties])
    where = "Signorini, P2, h = 1/24"
    found.add("V12", where, "rate in V over eps", in_v, 1.0, abs=0.1)


@pytest.mark.parametrize("dim", [2, 3])
def test_v14_any_number_of_ranks_gives_the_same_solution(dim: int) -> None:
    radius = {"kernel": "helmholtz", "radius": 0.3}
    parameters = block(dim, 0.2 if dim == 2 else 0.5, friction__smoothing=radius)
    together = solved(parameters, P2, MPI.COMM_WORLD).summary
    alone = solved(parameters, P2, MPI.COMM_SELF).summary
    for key in ("compliance", "elastic_energy", "slip_area", "contact_force", "friction_force"):
        assert together[key] == pytest.approx(alone[key], rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
def test_v15_r_of_control_values_keeps_constants_and_means(
    dim: int, kernel: str, found: Rows
) -> None:
    foot = Foot(dim, 0.1 if dim == 2 else 0.25, P2)
    smoothing = foot.smoothing(kernel, 0.3)
    change = foot.maximum(smoothing.apply(3.0 * np.ones(len(foot.surface.nodes))) - 3.0)
    assert change <= 1e-12
    where = f"R of 3, {dim}D, {kernel}, P2"
    found.add("V15", where, "largest change", change, None)
    wave = 1.0 + np.cos(math.pi * foot.surface.points[:, 0])
    smoothed = smoothing.apply(wave)
    if kernel == "helmholtz":
        total = float(foot.surface.integral(wave))
        assert float(foot.surface.integral(smoothed)) == pytest.approx(total, rel=1e-10)
        damped = 1.0 + np.cos(math.pi * foot.surface.points[:, 0]) / (1.0 + 0.09 * math.pi**2)
        error = float(np.sqrt(foot.surface.integral((smoothed - damped) ** 2)))
        assert error <= 0.01
    smoothing.destroy()


def nearly_incompressible(divisions: int) -> Parameters:
    """The block with nu = 0.4999 on its foundation, without a limit of the strain."""
    return block(
        2,
        1.0 / divisions,
        mesh__structured=True,
        material__elasticity={"young": 1.0, "poisson": 0.4999},
        material__locking_limit=math.inf,
        friction__smoothing__radius=0.3,
        penalty__n=math.inf,
    )


@pytest.mark.serial
def test_v16_a_nearly_incompressible_block_does_not_lock(found: Rows, comm: MPI.Intracomm) -> None:
    reference = solved(nearly_incompressible(32), P2, comm).summary
    for name, element, divisions in (("P1", P1, 16), ("P2", P2, 8)):
        summary = solved(nearly_incompressible(divisions), element, comm).summary
        assert summary["dofs"] == 578
        computed, exact = summary["compliance"], reference["compliance"]
        where = f"block on its foundation, nu = 0.4999, {name}, 578 unknowns"
        found.add("V16", where, "compliance (P2, 8450)", computed, exact)
        error = abs(computed / exact - 1.0)
        assert error < 0.02 if element is P2 else error > 0.2


def cantilever(h: float) -> Parameters:
    """A beam of length 20 and height 1, clamped on the left and pulled down on the right."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": 2, "size": [20.0, 1.0], "h": h, "structured": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {
            "tractions": [{"on": "right", "value": [0.0, -1e-5]}],
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
        },
        "contact": {"on": []},
    }
    return with_changes(data)


@pytest.mark.serial
def test_v17_a_thin_beam_bends_as_timoshenko_says(found: Rows, comm: MPI.Intracomm) -> None:
    force, length, stiffness, shear = 1e-5, 20.0, 1.0 / (1.0 - 0.3**2), 1.0 / 2.6
    exact = force**2 * (4.0 * length**3 / stiffness + 1.2 * length / shear)
    for name, element, h in (("P1", P1, 0.5), ("P2", P2, 1.0)):
        summary = solved(cantilever(h), element, comm).summary
        assert summary["dofs"] == 246
        where = f"cantilever of length 20 and height 1, {name}, 246 unknowns"
        found.add("V17", where, "compliance", summary["compliance"], exact)
        error = abs(summary["compliance"] / exact - 1.0)
        assert error < 0.02 if element is P2 else error > 0.4
