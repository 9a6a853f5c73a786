"""kappa, below which no other displacement solves the problem with friction on the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import ufl
from certified import certificate
from dolfinx import fem
from mpi4py import MPI
from problems import with_changes

from contact_locking.laws.body import isotropic_stress, lame_from_young, strain
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters
from contact_locking.theory.constants import BY_KAPPA, UNKNOWN

YOUNG, POISSON = 1.0, 0.3


def block(h: float = 0.25, degree: int = 1, **changes: Any) -> Parameters:
    """An elastic block that its clamped top presses onto the foundation."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": 2, "size": [1.0, 1.0], "h": h, "structured": True},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {
            "tractions": [{"on": "right", "value": [0.01, -0.02]}],
            "displacements": [{"on": "top", "value": [0.0, -0.01]}],
        },
        "contact": {"on": "bottom"},
        "friction": {"coefficient": 0.1, "smoothing": {"kernel": "convolution", "radius": 0.4}},
        "discretisation": {"degree": degree},
        "certificate": {"constants": True},
    }
    return with_changes(data, **changes)


def uniqueness(parameters: Parameters) -> dict[str, Any]:
    return dict(certificate(parameters)["constants"]["uniqueness"])


SLIDING = {"displacements": [{"on": "left", "value": [0.0, None]}], "body_force": [0.0, -0.01]}
PUSHED = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}, "force": [0.0, 0.01]}
STACKED = {
    "mesh": {"builder": "stack", "size": [1.0, 0.5], "upper": [1.0, 0.5], "h": 0.5},
    "loads": {
        "displacements": [
            {"on": "bottom", "value": [0.0, 0.0]},
            {"on": "top", "value": [0.0, -0.01]},
        ]
    },
    "contact": {"on": "upper_bottom", "against": "lower_top"},
}


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "verdict", "why"),
    [
        ({}, BY_KAPPA, "is below 1"),
        # The norms of contact do not depend on its stiffness.
        ({"penalty": {"n": 1e3}}, BY_KAPPA, "is below 1"),
        ({"friction__regularisation": 1e-3}, BY_KAPPA, "is below 1"),
        ({"friction__coefficient": 0.4}, UNKNOWN, "is not below 1"),
        ({"friction__coefficient": "0.1 + 0*s"}, UNKNOWN, "depends on the slip"),
        ({"friction__coefficient": "0.1*x"}, BY_KAPPA, "is below 1"),
        ({"material__locking_limit": 0.5}, UNKNOWN, "can lock next to Gamma_C"),
        ({"contact__on": ["bottom"], "certificate": {}}, UNKNOWN, "certificate.constants is false"),
        ({"loads": SLIDING}, UNKNOWN, "displacement conditions alone do not hold the body"),
        ({"contact": [{"on": "bottom"}, {"on": "left"}]}, UNKNOWN, "two contacts acts at one node"),
        ({"contact__foundation": PUSHED}, UNKNOWN, "forces decide where a foundation is"),
        (STACKED, UNKNOWN, "two bodies touch"),
    ],
)
def test_the_verdict_says_kappa_or_which_hypothesis_fails(
    changes: dict[str, Any], verdict: str, why: str
) -> None:
    found = uniqueness(block(**changes))
    assert found["verdict"] == verdict and why in found["why"], found
    assert (found["kappa"] is not None) == ("below 1" in why)


def test_a_body_that_locks_away_from_the_contact_has_a_kappa() -> None:
    mesh = {"builder": "inclusion", "dim": 2, "h": 0.15}
    elastic = uniqueness(block(mesh=mesh))
    found = uniqueness(block(mesh=mesh, material__regions={"inclusion": {"locking_limit": 0.02}}))
    assert found["verdict"] == BY_KAPPA
    # The fields w_g vanish in the inclusion, so that their energy is larger.
    assert elastic["kappa"] < found["kappa"] < 2.0 * elastic["kappa"]


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, 2])
def test_kappa_is_that_of_dense_matrices(degree: int) -> None:
    problem = assemble(block(degree=degree), MPI.COMM_WORLD)
    found = solve_assembled(problem).summary["certificate"]["constants"]["uniqueness"]["kappa"]
    (contact,) = problem.contacts
    space, surface = problem.u.function_space, contact.surface
    v, w = ufl.TestFunction(space), ufl.TrialFunction(space)
    stress = isotropic_stress(strain(w), *lame_from_young(YOUNG, POISSON))
    form = fem.assemble_matrix(fem.form(ufl.inner(stress, strain(v)) * ufl.dx))
    stiffness = form.to_dense()
    is_free = problem.constraints.free_dofs() > 0.0
    weights, limited = surface.weights, surface.controls.of_blocks.toarray()
    along = np.kron(limited, [1.0, 0.0])[:, is_free]
    compliance = np.linalg.solve(stiffness[np.ix_(is_free, is_free)], along.T)
    root = np.sqrt(weights)
    trace = np.linalg.eigvalsh(root[:, None] * (along @ compliance) * root).max()

    # Displacements on Gamma_C from normal limited values, and the energy of their extension.
    inverse = np.linalg.inv(limited[:, surface.blocks])
    normal = np.zeros((len(stiffness), len(weights)))
    normal[2 * surface.blocks + 1] = -inverse
    on_contact = np.zeros(len(stiffness), dtype=bool)
    on_contact[[*(2 * surface.blocks), *(2 * surface.blocks + 1)]] = True
    inside = is_free & ~on_contact
    loads = stiffness[inside] @ normal
    energy = normal.T @ stiffness @ normal - loads.T @ np.linalg.solve(
        stiffness[np.ix_(inside, inside)], loads
    )
    smoothing = np.stack(
        [contact.friction.smoothing.apply(column) for column in np.eye(len(weights))], axis=1
    )
    pushed = 0.1 * (smoothing.T * weights) / weights[:, None]
    lift = np.linalg.eigvalsh((pushed / root).T @ energy @ (pushed / root)).max()
    assert found == pytest.approx(np.sqrt(trace * lift), rel=1e-6)
    problem.close()
