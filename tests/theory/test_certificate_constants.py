"""The certificate's constants of trace and friction, and what they say of uniqueness."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from certified import certificate
from mpi4py import MPI
from problems import block, column

from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound
from contact_locking.laws.friction import FrictionLaw
from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import assemble
from contact_locking.theory.constants import SAMPLED

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("dim", [2, 3])
def test_trace_constant_of_a_column_under_its_fixed_top_is_the_root_of_its_height(dim: int) -> None:
    rollers = [{"on": ["left", "right"], "value": [0.0] + [None] * (dim - 1)}]
    if dim == 3:
        rollers.append({"on": ["front", "back"], "value": [None, 0.0, None]})
    top = {"on": "top", "value": [0.0] * (dim - 1) + [-0.01]}
    found = certificate(
        column(
            dim,
            loads={"displacements": [*rollers, top]},
            contact__gap=0.0,
            certificate__constants=True,
        )
    )["constants"]
    # v = (0, 2 - y): |v|^2 on the bottom is 4, |eps(v)|^2 is 2.
    assert found["c_0"] == pytest.approx(math.sqrt(2.0), rel=1e-6)
    assert found["alpha"] == pytest.approx(1.0 / 1.3)


def test_constants_of_a_slip_dependent_coefficient_are_sampled() -> None:
    found = certificate(block(friction__coefficient="0.4 - 0.3*(1 - exp(-s/0.005))"))["constants"]
    assert found["friction_constants"] == "sampled"
    assert found["friction_coefficient"] == pytest.approx(0.4)
    assert found["friction_lipschitz"] == pytest.approx(60.0, rel=1e-3)
    assert found["c_0"] is None and "certificate.constants" in found["c_0_reason"]


@pytest.mark.parametrize(
    ("changes", "verdict", "why"),
    [
        ({"friction__coefficient": 0.0}, "covered by theory", "no friction"),
        ({"friction__coefficient": 0.05, "penalty__epsilon": 0.1}, SAMPLED, "is below"),
        ({"friction__coefficient": 0.3}, "not known", "is not below"),
        ({"penalty__n": math.inf}, "not known", "can lock beside Gamma_C"),
    ],
)
def test_uniqueness_is_covered_by_theory_by_sampled_constants_or_not_known(
    changes: dict[str, Any], verdict: str, why: str
) -> None:
    found = certificate(block(certificate__constants=True, **changes))["constants"]["uniqueness"]
    assert found["verdict"] == verdict and why in found["why"]


def test_a_coefficient_of_place_alone_has_exact_constants() -> None:
    found = certificate(block(friction__coefficient="0.1 + 0.2*x"))["constants"]
    assert (found["friction_coefficient"], found["friction_lipschitz"]) == (pytest.approx(0.3), 0.0)
    assert found["friction_constants"] == "exact"


def constants_of(law: Any, bound: type[FrictionBound] = FrictionBound) -> dict[str, Any]:
    """The constants of a soft block with another friction law than the study file's."""
    study = block(h=0.2, penalty__epsilon=0.1, certificate__constants=True)
    problem = assemble(study, MPI.COMM_WORLD)
    (contact,) = problem.contacts
    contact.friction = bound(contact.surface, contact.friction.smoothing, law)
    return dict(solve_assembled(problem).summary["certificate"]["constants"])


def slip_weakening(points: FloatArray, slip: FloatArray) -> FloatArray:
    """mu* = 0.02, L_mu = 0.01."""
    return 0.01 + 0.01 * np.exp(-slip)


def test_the_certificate_asks_a_law_of_the_users_own_for_its_constants() -> None:
    plain = constants_of(slip_weakening)
    assert plain["friction_constants"] == "sampled"
    assert plain["friction_coefficient"] == pytest.approx(0.02)
    assert plain["friction_lipschitz"] == pytest.approx(0.01, rel=0.01)
    assert plain["uniqueness"]["verdict"] == SAMPLED and "sampled" in plain["uniqueness"]["why"]
    stated = constants_of(FrictionLaw(slip_weakening, largest=0.02, lipschitz=0.011))
    assert stated["friction_constants"] == "exact"
    assert (stated["friction_coefficient"], stated["friction_lipschitz"]) == (0.02, 0.011)
    assert "mu* and L_mu sampled" not in stated["uniqueness"]["why"]


def test_a_bound_of_the_users_own_has_no_verdict() -> None:
    class Capped(FrictionBound):
        def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
            return np.minimum(super().evaluate(pressure, slip), 0.004)

    found = constants_of(slip_weakening, Capped)["uniqueness"]
    assert found["verdict"] == "not known" and "user's own" in found["why"]
