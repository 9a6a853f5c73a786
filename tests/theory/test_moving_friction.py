"""The bound of the whole error with the friction bound that moves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import ufl
from certified import certificate, solved
from mpi4py import MPI
from test_kappa import POISSON, YOUNG, block

from contact_locking.fem.compiled import integral
from contact_locking.laws.elasticity import isotropic_stress, lame_from_young, strain
from contact_locking.process.adaptivity.sharper_bound import on_mesh_of
from contact_locking.process.of_study import solver_of
from contact_locking.study.assembly import assemble
from contact_locking.theory.guaranteed.body import Body
from contact_locking.theory.guaranteed.contact_tractions import contact_tractions
from contact_locking.theory.guaranteed.data_oscillation import trace_constants
from contact_locking.theory.guaranteed.macro_element import macro_element
from contact_locking.theory.guaranteed.moving_bound import slip_constant
from contact_locking.theory.guaranteed.triangles import Triangles


@pytest.mark.serial
@pytest.mark.parametrize(("coefficient", "estimated"), [(0.1, False), (0.2, True)])
def test_the_bound_is_above_the_distance_to_a_finer_solution(
    coefficient: float, estimated: bool
) -> None:
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
        assert found["estimated"] is estimated is ("estimated" in found["reason"])
        assert found["energy_norm"] > errors["guaranteed"]["energy_norm"] >= error
        assert found["energy_norm"] < largest * error / (1.0 - found["kappa"])
        assert found["kappa"] == kappa if estimated else found["kappa"] > kappa


def test_the_constant_of_the_slip_is_that_of_simple_shear_and_what_facets_do_not_resolve() -> None:
    # Between rollers and under a clamped top the largest slip is that of simple shear: c_0^2 is
    # the height over the shear modulus.
    rollers = [{"on": side, "value": [None, 0.0]} for side in ("left", "right")]
    held = [*rollers, {"on": "top", "value": [0.0, 0.0]}]
    solver = solver_of(assemble(block(loads={"displacements": held}), MPI.COMM_WORLD))
    state = solver.state(solver.solve())
    triangles = Triangles(state.problem.domain)
    contacts = [contact_tractions(fields, triangles) for fields in state.contacts]
    elasticity = Body(state, triangles, macro_element(1)).elasticity
    found = slip_constant(state, elasticity, contacts)
    shear = lame_from_young(YOUNG, POISSON)[1]
    # All triangles are alike, and alpha is twice the shear modulus.
    (facet,) = np.unique(np.round(triangles.lengths.min(axis=1), 12))
    rest = trace_constants(triangles)[triangles.lengths < facet * 1.01].max() ** 2 / (2.0 * shear)
    assert found**2 == pytest.approx(1.0 / shear + rest, rel=1e-5)


def test_the_bound_follows_from_its_parts() -> None:
    proofs = certificate(block(certificate__error_bound=True))
    errors, rho = proofs["errors"], proofs["constants"]["uniqueness"]["rho"]
    found = errors["moving_friction"]
    kappa = found["kappa"]
    # The loads are polynomials, and in an elastic body the bound is that of Prager and Synge, but
    # for the slack of contact.
    frozen = errors["guaranteed"]["energy_norm"]
    most = frozen + (kappa * frozen + kappa / rho * found["residual"]) / (1.0 - kappa)
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
