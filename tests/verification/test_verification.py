"""Problems with known answers (V1, V6, V14, V15): computed beside exact."""

from __future__ import annotations

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block, column, solved
from verification_table import Rows

from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import (
    ConvolutionOperator,
    HelmholtzOperator,
    Identity,
    Smoothing,
)
from contact_locking.contact.surface import ContactSurface
from contact_locking.fem.spaces import P1, Element
from contact_locking.laws.body import lame_from_young
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.sources import from_geometry
from contact_locking.meshes.block import Block
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters

LAME_LAMBDA, LAME_MU = lame_from_young(1.0, 0.3)
K = LAME_LAMBDA + 2.0 * LAME_MU


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("pressure", [0.01, 0.05])
@pytest.mark.parametrize(("n", "epsilon"), [(1e3, 1e-4), (1e6, 1e-2)])
def test_v1_column_in_uniaxial_strain_is_exact(
    dim: int, pressure: float, n: float, epsilon: float, found: Rows
) -> None:
    parameters = column(dim, pressure, penalty__n=n, penalty__epsilon=epsilon)
    solution = solving.solve(parameters)
    summary = solution.summary
    limit = 0.02
    exact = (
        pressure / K if pressure <= K * limit else (limit + (pressure - K * limit) / (K + 2.0 * n))
    )
    assert summary["converged"], summary["reason"]
    assert summary["strain_norm_max"] == pytest.approx(exact, rel=1e-8)
    assert np.ptp(solution.strain_norm.x.array) <= 1e-8 * exact
    where = f"column, {dim}D, p = {pressure:g}, n = {n:g}, eps = {epsilon:g}"
    found.add("V1", where, "strain", summary["strain_norm_max"], exact)
    sunk = pressure * epsilon
    found.add("V1", where, "penetration", summary["penetration_max"], sunk)
    assert summary["penetration_max"] == pytest.approx(pressure * epsilon, rel=1e-8)
    assert summary["contact_force"][-1] == pytest.approx(pressure, rel=1e-8)
    assert summary["locked_fraction"] == (1.0 if pressure > K * limit else 0.0)
    # The top sinks by the gap, the penetration and the shortening of the column.
    sinks = 0.1 + pressure * epsilon + 2.0 * exact
    assert summary["compliance"] == pytest.approx(pressure * sinks, rel=1e-8)
    if solution.contact_points is not None:
        assert solution.contact_points.pressure == pytest.approx(pressure, rel=1e-7)


HALF_WIDTH, PEAK = 0.681, 9.35


def pressed_cylinder(h_contact: float, **discretisation: int) -> StudySolution:
    """V6: a cylinder of radius 8 that a force of 10 presses onto a plane, as its lower half."""
    parameters = Parameters.model_validate(
        {
            "mesh": {
                "builder": "disc",
                "radius": 8.0,
                "h": 1.0,
                "h_contact": h_contact,
                "contact_width": 1.5,
            },
            "discretisation": discretisation,
            "material": {"elasticity": {"young": 200.0, "poisson": 0.3}},
            "loads": {
                "tractions": [{"on": "top", "value": [0.0, -10.0 / 16.0]}],
                "displacements": [{"on": "top", "value": [0.0, None]}],
            },
            "contact": {
                "on": "contact",
                "foundation": {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}},
            },
            "penalty": {"n": 1e4, "epsilon": 1e-5},
        }
    )
    solution = solved(parameters)
    assert solution.summary["contact_force"] == pytest.approx([0.0, 10.0], abs=1e-6)
    return solution


@pytest.mark.serial
def test_v6_hertz_line_contact_has_the_half_width_and_peak_of_theory(found: Rows) -> None:
    solution = pressed_cylinder(0.05)
    half = solution.summary["contact_area"] / 2
    found.add("V6", "cylinder on a plane", "half-width", half, HALF_WIDTH, rel=0.05)
    if solution.contact_points is not None:
        largest = float(solution.contact_points.pressure.max())
        found.add("V6", "cylinder on a plane", "peak pressure", largest, PEAK, rel=0.05)


def _fingerprint(solution: StudySolution) -> FloatArray:
    """Numbers that any error of the parallel code would change."""
    summary = solution.summary
    square = fem.assemble_scalar(
        fem.form(ufl.inner(solution.displacement, solution.displacement) * ufl.dx)
    )
    keys = ("compliance", "elastic_energy", "strain_norm_max", "locked_fraction", "slip_area")
    numbers = [summary[key] for key in keys] + summary["contact_force"] + summary["friction_force"]
    return np.array([*numbers, solution.domain.comm.allreduce(square)])


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz", "none"])
@pytest.mark.parametrize("dim", [2, 3])
def test_v14_any_number_of_ranks_gives_the_same_solution(dim: int, kernel: str) -> None:
    h = 0.1 if dim == 2 else 0.3
    # Solutions to the default tolerances of 1e-8 may differ by more than the test allows.
    sharp = {"tolerance": 1e-10, "friction_tolerance": 1e-10}
    smoothing = {"kernel": kernel, "radius": 0.3}
    parameters = block(dim, h, friction__smoothing=smoothing, solver=sharp)
    together = solving.solve(parameters, MPI.COMM_WORLD)
    alone = solving.solve(parameters, MPI.COMM_SELF)
    assert together.converged and alone.converged
    assert _fingerprint(together) == pytest.approx(_fingerprint(alone), rel=1e-8, abs=1e-12)
    points, expected = together.contact_points, alone.contact_points
    facets, expected_facets = together.contact_facets, alone.contact_facets
    if facets is not None:
        assert expected_facets is not None and facets.tolist() == expected_facets.tolist()
    if points is not None:
        assert expected is not None
        assert points.x == pytest.approx(expected.x, abs=1e-14)
        assert points.pressure == pytest.approx(expected.pressure, rel=1e-7, abs=1e-9)
        assert points.traction == pytest.approx(expected.traction, rel=1e-7, abs=1e-9)


class Foot:
    """Gamma_C of a block, with R of each kind on it."""

    def __init__(self, dim: int, h: float, element: Element = P1) -> None:
        geometry = Block(dim=dim, size=(1.0,) * dim, h=max(h, 0.1), h_contact=h)
        self.domain: Domain = from_geometry(geometry, MPI.COMM_WORLD)
        space = element.displacement_space(self.domain.mesh)
        self.surface = ContactSurface(self.domain, space, ("bottom",), element=element)

    def smoothing(self, kernel: str, radius: float) -> Smoothing:
        surface = self.surface
        if kernel == "convolution":
            return ConvolutionOperator(self.domain.comm, surface.whole(), radius)
        if kernel == "helmholtz":
            whole, laplacian = surface.whole(), surface.laplacian()
            return HelmholtzOperator(self.domain.comm, whole, laplacian, radius)
        return Identity()

    def maximum(self, values: FloatArray) -> float:
        local = float(np.abs(values).max(initial=0.0))
        return float(self.domain.comm.allreduce(local, op=MPI.MAX))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["convolution", "helmholtz", "none"])
def test_v15_r_keeps_constants_and_positivity(dim: int, kernel: str, found: Rows) -> None:
    foot = Foot(dim, 0.1 if dim == 2 else 0.2)
    smoothing = foot.smoothing(kernel, 0.3)
    ones = np.ones(len(foot.surface.nodes))
    change = foot.maximum(smoothing.apply(3.0 * ones) - 3.0)
    found.add("V15", f"R of 3, {dim}D, {kernel}", "largest change", change, None, abs=1e-12)
    spike = np.where(foot.surface.points[:, 0] > 0.45, 1.0, 0.0)
    smoothed = smoothing.apply(spike)
    # A mollifier stays between the least and the greatest of what it averages, so (R w, 1) is
    # bounded by max(w) |Gamma_C|; for the Helmholtz filter (R w, 1) = (w, 1) even.
    assert np.all(smoothed >= -1e-12)
    assert np.all(smoothed <= 1.0 + 1e-12)
    total = float(foot.surface.integral(spike))
    if kernel != "convolution":
        assert foot.surface.integral(smoothed) == pytest.approx(total, rel=1e-12)
    else:
        assert 0.5 * total <= foot.surface.integral(smoothed) <= 2.0 * total
    smoothing.destroy()


@pytest.mark.serial
@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
def test_v15_r_tends_to_the_identity_with_the_square_of_its_radius(
    kernel: str, found: Rows
) -> None:
    foot = Foot(2, 1.0 / 256)
    # Even about both ends, so that the normalisation there does not lower the order.
    wave = np.cos(2.0 * np.pi * foot.surface.points[:, 0])
    radii = np.array([0.08, 0.04, 0.02])
    errors = []
    for radius in radii:
        smoothing = foot.smoothing(kernel, float(radius))
        difference = smoothing.apply(wave) - wave
        errors.append(np.sqrt(foot.surface.integral(difference**2)))
        smoothing.destroy()
    rate = np.polyfit(np.log(radii), np.log(errors), 1)[0]
    found.add("V15", f"R - I, {kernel}", "rate in its radius", float(rate), 2.0)
    assert rate == pytest.approx(2.0, abs=0.2)


@pytest.mark.serial
def test_v15_helmholtz_filter_damps_a_cosine_by_one_over_one_plus_r2_k2() -> None:
    foot = Foot(2, 1.0 / 128)
    wave_number = 2.0 * np.pi
    wave = np.cos(wave_number * foot.surface.points[:, 0])
    smoothing = foot.smoothing("helmholtz", 0.2)
    exact = wave / (1.0 + (0.2 * wave_number) ** 2)
    assert foot.maximum(smoothing.apply(wave) - exact) <= 1e-3
    smoothing.destroy()


@pytest.mark.serial
def test_v15_convolution_of_a_linear_function_is_exact_away_from_the_ends() -> None:
    foot = Foot(2, 1.0 / 64)
    x = foot.surface.points[:, 0]
    smoothed = foot.smoothing("convolution", 0.1).apply(2.0 * x + 1.0)
    inside = (x > 0.11) & (x < 0.89)
    assert smoothed[inside] == pytest.approx(2.0 * x[inside] + 1.0, abs=1e-3)
