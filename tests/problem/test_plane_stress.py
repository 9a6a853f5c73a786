"""Plane stress: uniaxial tension by hand, with and without limits of the strain in the plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from problems import with_changes

from contact_locking.laws.body import lame_from_young, plane_stress_lambda
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

YOUNG, POISSON, TENSION, LIMIT = 2.0, 0.4, 0.05, 0.015
LAME_LAMBDA, LAME_MU = lame_from_young(YOUNG, POISSON)


def sheet(**changes: Any) -> Parameters:
    """A sheet that tension pulls upwards, free to become narrower."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 1.0], "h": 0.5},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}, "plane": "stress"},
        "loads": {
            "tractions": [{"on": "top", "value": [0.0, TENSION]}],
            "displacements": [
                {"on": "bottom", "value": [None, 0.0]},
                {"on": "left", "value": [0.0, None]},
            ],
        },
        "contact": {"on": []},
    }
    return with_changes(data, **changes)


def solved(**changes: Any) -> StudySolution:
    solution = solving.solve(sheet(**changes))
    assert solution.converged, solution.summary["reason"]
    return solution


def strains(solution: StudySolution) -> tuple[float, float]:
    """The strains along x and y, which are the displacements of the far corner."""
    u = solution.displacement.x.array.reshape(-1, 2)
    x = solution.displacement.function_space.tabulate_dof_coordinates()[:, :2]
    (corner,) = np.flatnonzero(x.sum(axis=1) > 2.0 - 1e-9)
    width, height = u[corner]
    assert u == pytest.approx(x * [width, height], abs=1e-8)
    return float(width), float(height)


@pytest.mark.parametrize(
    "elasticity",
    [{"young": YOUNG, "poisson": POISSON}, {"lambda": LAME_LAMBDA, "mu": LAME_MU}],
)
def test_tension_meets_youngs_modulus_and_poissons_ratio(elasticity: dict[str, float]) -> None:
    solution = solved(material__elasticity=elasticity)
    wide, high = strains(solution)
    assert high == pytest.approx(TENSION / YOUNG, rel=1e-9)
    assert wide == pytest.approx(-POISSON * TENSION / YOUNG, rel=1e-9)
    # Plane strain is stiffer.
    assert strains(solved(material__plane="strain"))[1] == pytest.approx(
        TENSION * (1.0 - POISSON**2) / YOUNG, rel=1e-9
    )


def test_the_limit_is_that_of_the_strain_in_the_plane() -> None:
    """``Z = zeta eps`` adds zeta/2 to mu and leaves lambda, until ``|(e_x, e_y)| = M``."""
    solution = solved(material__locking_limit=LIMIT)
    wide, high = strains(solution)
    assert math.hypot(wide, high) == pytest.approx(LIMIT, rel=1e-7)
    lame_lambda = plane_stress_lambda(LAME_LAMBDA, LAME_MU)
    # No stress along x: 2 mu' = -lambda (e_x + e_y)/e_x; the tension along y.
    twice_mu = -lame_lambda * (wide + high) / wide
    assert twice_mu > 2.0 * LAME_MU
    # A duality gap of 1e-8 tells the direction of the strain on the sphere to its root.
    assert lame_lambda * (wide + high) + twice_mu * high == pytest.approx(TENSION, rel=1e-4)
    bound = solving.solve(sheet(material__locking_limit=LIMIT, certificate__error_bound=True))
    assert bound.summary["certificate"]["errors"]["guaranteed"]["applicable"] is True


def test_fibres_along_the_tension_stop_at_their_limit_and_carry_the_rest() -> None:
    fibres = {"norm": "direction", "along": [0.0, 1.0], "at_most": LIMIT}
    wide, high = strains(solved(material__locking=[fibres]))
    assert high == pytest.approx(LIMIT, rel=1e-7)
    assert wide == pytest.approx(-POISSON * LIMIT, rel=1e-6)
