"""The estimated bound of the whole error with the friction bound that moves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import ufl
from certified import certificate, solved
from test_kappa import POISSON, YOUNG, block

from contact_locking.convergence import on_mesh_of
from contact_locking.fem.compiled import integral
from contact_locking.laws.elasticity import isotropic_stress, lame_from_young, strain


@pytest.mark.serial
@pytest.mark.parametrize("coefficient", [0.1, 0.2])
def test_the_estimate_is_above_the_distance_to_a_finer_solution(coefficient: float) -> None:
    changes = {"friction__coefficient": coefficient, "friction__smoothing__radius": 0.2}
    reference = solved(block(1 / 32, 2, **changes))
    for degree, largest in ((1, 3.0), (2, 6.0)):
        solution = solved(block(1 / 8, degree, certificate__error_bound=True, **changes))
        errors = solution.summary["certificate"]["errors"]
        apart = on_mesh_of(solution.displacement, reference.displacement)
        apart.x.array[:] -= reference.displacement.x.array
        stress = isotropic_stress(strain(apart), *lame_from_young(YOUNG, POISSON))
        energy = ufl.inner(stress, strain(apart))
        error = math.sqrt(integral(reference.domain, energy * ufl.dx))
        found, kappa = errors["moving_friction"], _kappa(solution.summary["certificate"])
        assert "estimated" in found["reason"]
        assert found["energy_norm"] > errors["guaranteed"]["energy_norm"] >= error
        assert found["energy_norm"] < largest * error / (1.0 - kappa)


def test_the_estimate_follows_from_its_parts() -> None:
    proofs = certificate(block(certificate__error_bound=True))
    errors, constants = proofs["errors"], proofs["constants"]["uniqueness"]
    found, kappa = errors["moving_friction"], _kappa(proofs)
    assert kappa == pytest.approx(constants["c"] * constants["rho"])
    # The loads are polynomials, and in an elastic body the bound is that of Prager and Synge, but
    # for the slack of contact.
    frozen = errors["guaranteed"]["energy_norm"]
    most = frozen + (kappa * frozen + constants["c"] * found["residual"]) / (1.0 - kappa)
    assert found["energy_norm"] == pytest.approx(most, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"friction__coefficient": 0.4}, "is not below 1"),
        ({"material__locking_limit": 0.5}, "can lock beside Gamma_C"),
        ({"contact__gap": "0.001*x*(1 - x)"}, "no bound for the friction bound kept fixed"),
    ],
)
def test_there_is_no_estimate_where_a_hypothesis_fails(changes: dict[str, Any], why: str) -> None:
    found = certificate(block(certificate__error_bound=True, **changes))["errors"][
        "moving_friction"
    ]
    assert found["energy_norm"] is None and found["relative"] is None
    assert found["reason"].startswith("not applicable") and why in found["reason"]


def test_without_friction_there_is_nothing_to_estimate() -> None:
    study = block(certificate__error_bound=True, friction__coefficient=0.0)
    assert "moving_friction" not in certificate(study)["errors"]


def _kappa(proofs: dict[str, Any]) -> float:
    return float(np.asarray(proofs["constants"]["uniqueness"]["kappa"]))
