"""Contact of bodies whose curved boundary is made of chords, with a foundation that follows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from verification_table import Rows

from contact_locking import StudySolution, solve
from contact_locking.fem.compiled import integral
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial

PRESS, NU = 0.01, 0.3
# Lame's pressure on a ring of the radii 1 and 2, E = 1, that is pressed inwards by PRESS.
LAME = PRESS / (2.0 * (1.0 - NU**2) * (5.0 / 3.0 - NU / (1.0 - NU)))


def solved(data: dict[str, Any]) -> StudySolution:
    solution = solve(
        from_mapping(
            data
            | {"material": {"elasticity": {"young": 1.0, "poisson": NU}}}
            | {"output": {"picture": False}}
        )
    )
    assert solution.converged, solution.summary["reason"]
    assert all(text.code == "strain.large" for text in solution.warnings)
    return solution


def pressures(solution: StudySolution) -> Any:
    return np.concatenate(MPI.COMM_WORLD.allgather(solution.contacts[0].pressure))


@pytest.mark.parametrize(("degree", "scatter"), [(1, 0.01), (2, 0.003)])
def test_a_ring_in_a_rigid_ring_has_the_pressure_of_lame_at_every_node(
    degree: int, scatter: float, found: Rows
) -> None:
    pressure = pressures(
        solved(
            {
                "mesh": {"builder": "annulus", "h": 0.2, "quarter": True},
                "loads": {
                    "displacements": [
                        {"on": "bottom", "value": [None, 0]},
                        {"on": "left", "value": [0, None]},
                    ]
                },
                "contact": {
                    "on": "outer",
                    "foundation": {"expression": f"{2.0 - PRESS} - sqrt(x**2 + y**2)"},
                },
                "discretisation": {"degree": degree},
            }
        )
    )
    where = f"ring in a rigid ring, degree {degree}, h = 0.2"
    found.add("V28", where, "mean pressure", float(np.mean(pressure)), LAME)
    share = float(np.std(pressure)) / LAME
    found.add("V28", where, "scatter of the pressure", share, None, abs=scatter)
    assert np.mean(pressure) == pytest.approx(LAME, rel=0.015)


def test_a_ball_in_a_rigid_shell_has_a_hydrostatic_pressure(found: Rows) -> None:
    tool = {"expression": f"{1.0 - PRESS} - sqrt(x**2 + (y - 1)**2)"}
    half_section = {"builder": "disc", "axisymmetric": True, "quarter": True}
    pressure = pressures(
        solved(
            {
                "mesh": half_section | {"contact_width": 0.6, "h": 0.1},
                "loads": {"displacements": [{"on": "top", "value": [None, 0]}]},
                "contact": {"on": ["contact", "side"], "foundation": tool},
                "discretisation": {"degree": 2},
            }
        )
    )
    exact = PRESS / (1.0 - 2.0 * NU)
    where = "ball in a rigid shell, half section, degree 2, h = 0.1"
    found.add("V28", where, "mean pressure", float(np.mean(pressure)), exact)
    scatter = float(np.std(pressure)) / exact
    found.add("V28", where, "scatter of the pressure", scatter, None, abs=0.005)
    assert np.mean(pressure) == pytest.approx(exact, rel=0.005)


def test_a_disc_in_its_own_field_of_forces_converges_at_the_rate_of_its_boundary(
    found: Rows,
) -> None:
    # A disc of radius 1 with the force x - c per volume, as where it turns about its centre c:
    # u = (a - b r^2) (x - c) without a traction at r = 1.
    lame, shear = NU / ((1.0 + NU) * (1.0 - 2.0 * NU)), 1.0 / (2.0 * (1.0 + NU))
    b = 1.0 / (8.0 * (lame + 2.0 * shear))
    a = b * (4.0 * lame + 6.0 * shear) / (2.0 * lame + 2.0 * shear)
    errors: list[list[float]] = []
    for h in (0.2, 0.1):
        solution = solved(
            {
                "mesh": {
                    **{"builder": "disc", "quarter": True, "h": h, "contact_width": 0.5},
                },
                "loads": {
                    "displacements": [
                        {"on": "top", "value": [None, 0]},
                        {"on": "symmetry", "value": [0, None]},
                    ],
                    "body_force": ["x", "y - 1"],
                },
                "contact": {"on": []},
                "discretisation": {"degree": 2},
            }
        )
        domain = solution.domain
        away = ufl.SpatialCoordinate(domain.mesh) - ufl.as_vector([0.0, 1.0])
        error = solution.displacement - (a - b * ufl.inner(away, away)) * away
        strain, dx = ufl.sym(ufl.grad(error)), domain.dx(quadrature_degree=6)
        squares = (integral(domain, ufl.inner(e, e) * dx) for e in (strain, error))
        errors.append([float(np.sqrt(square)) for square in squares])
    rates = np.log2(np.array(errors[0]) / np.array(errors[1]))
    for name, error, rate in zip(("V", "L2"), errors[1], rates, strict=True):
        where = "turning disc, degree 2, h = 0.1"
        found.add("V28", where, f"error in {name}", float(error), None)
        assert rate == pytest.approx(1.8, abs=0.15)


def test_a_flat_body_with_quadratic_displacements_has_straight_edges() -> None:
    tool = {"sphere": {"centre": [0.5, -5.0], "radius": 5.0}}
    top = {"displacements": [{"on": "top", "value": [0.0, -0.01]}]}
    block = {"builder": "block", "size": [1, 1], "h": 0.25}
    whole_skin = {"on": ["bottom", "left", "right"], "foundation": tool}
    solution = solved(
        {"mesh": block, "loads": top, "contact": whole_skin, "discretisation": {"degree": 2}}
    )
    surface = solution.contacts[0].surface
    assert surface.places == pytest.approx(surface.points, abs=1e-12)
