"""A limit of the largest principal strain: its penalty, its solvers, and what follows from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from limits_of_strain import material
from mpi4py import MPI
from problems import block

import contact_locking as cl
from contact_locking.certificate import certify
from contact_locking.laws.locking import principal_energy, principal_stress
from contact_locking.process import of_study, solving
from contact_locking.solver.interior_point.principal_cones import TURN, Frame
from contact_locking.study_file.parameters import Parameters

LIMIT = 0.01
TEAR = {"norm": "largest_principal", "at_most": LIMIT}


def solved(parameters: Parameters) -> Mapping[str, Any]:
    summary = solving.solve(parameters).summary
    assert summary["converged"], summary["reason"]
    return summary


@pytest.mark.serial
@pytest.mark.parametrize(
    "strain",
    [
        [[0.0, 0.0], [0.0, 0.0]],
        [[0.03, 0.0], [0.0, 0.03]],
        [[0.03, 0.004], [0.004, 0.02]],
        [[0.015, 0.01], [0.01, -0.2]],
        [[0.009, 0.0], [0.0, 0.009]],
    ],
)
def test_the_penalty_is_the_squared_distance_and_the_stress_its_derivative(
    strain: list[list[float]],
) -> None:
    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    space = fem.functionspace(square, ("DG", 0, (2, 2)))
    eps, n = fem.Function(space), 7.0
    eps.x.array[:] = np.tile(np.ravel(strain), len(eps.x.array) // 4)
    values, vectors = np.linalg.eigh(strain)
    beyond = vectors @ np.diag(np.maximum(values - LIMIT, 0.0)) @ vectors.T
    inverse = fem.Constant(square, 1.0 / LIMIT)
    form = principal_energy(eps, inverse, n) * ufl.dx
    found = fem.assemble_scalar(fem.form(form))
    assert found == pytest.approx(n * np.sum(beyond**2), abs=1e-12)
    test = ufl.TestFunction(space)
    slope = fem.assemble_vector(fem.form(ufl.derivative(form, eps, test))).array
    stress = ufl.inner(principal_stress(eps, inverse, n), test) * ufl.dx
    assert slope == pytest.approx(fem.assemble_vector(fem.form(stress)).array, abs=1e-13)
    assert 0.5 * 2.0 * n * np.ravel(beyond) == pytest.approx(slope[:4], abs=1e-12)
    tangent = ufl.derivative(stress, eps, ufl.TrialFunction(space))
    assert np.isfinite(fem.assemble_matrix(fem.form(tangent)).to_dense()).all()


@pytest.mark.serial
def test_the_frame_is_orthonormal_also_at_the_tip_of_the_cone() -> None:
    assert pytest.approx(np.eye(3), abs=1e-15) == TURN @ TURN.T
    points = np.array([[1.0, 0.3, 0.0], [2.0, -0.2, 1.4], [1.0, 0.0, 0.0]]).T
    vectors = Frame.of(points).vectors
    products = np.einsum("iak,jak->kij", vectors, vectors)
    assert products == pytest.approx(np.broadcast_to(np.eye(3), products.shape), abs=1e-15)


def test_both_solvers_find_one_solution_of_the_penalised_problem() -> None:
    found = []
    for method in ("newton", "interior_point"):
        penalty = {"n": 1e3, "epsilon": 1e-3}
        given = block(2, 0.2, material=material(TEAR), penalty=penalty, solver__method=method)
        found.append(solved(given))
    for name in ("elastic_energy", "strain_norm_max", "locked_fraction", "compliance"):
        assert found[1][name] == pytest.approx(found[0][name], rel=1e-6)
    assert found[0]["locked_fraction"] > 0.1
    assert all(entry["holds"] for entry in found[0]["bounds"].values())


@pytest.mark.parametrize("linear", ["direct", "iterative"])
def test_the_limit_is_kept_and_no_smaller_principal_strain_has_one(linear: str) -> None:
    given = block(2, 0.2, material=material(TEAR), penalty__n=math.inf, solver__linear=linear)
    summary = solved(given)
    (entry,) = summary["strain_sets"]
    assert entry["utilisation_max"] == pytest.approx(1.0, abs=1e-6)
    # Where the block is squeezed it strains more than M.
    assert summary["strain_norm_max"] > 2.0 * LIMIT


@pytest.mark.serial
@pytest.mark.parametrize("limit_at", ["vertices", "gauss"])
def test_elements_of_degree_two_keep_the_limit(limit_at: str) -> None:
    given = block(
        2, 0.34, material=material(TEAR), penalty__n=math.inf,
        discretisation={"degree": 2, "limit_at": limit_at},
    )  # fmt: skip
    summary = solved(given)
    assert summary["strain_sets"][0]["utilisation_max"] == pytest.approx(1.0, abs=1e-6)
    # An affine strain that keeps a convex set at the vertices of a cell keeps the set in the cell.
    assert (summary["overstrain_max"] > 1e-3) == (limit_at == "gauss")


@pytest.mark.serial
def test_steps_go_on_from_the_pieces_of_the_limit_and_balance_the_energy() -> None:
    data = block(2, 0.25, material=material(TEAR), penalty__n=math.inf).model_dump(by_alias=True)
    data["steps"] = {"times": [0.5, 0.75, 1.0]}
    data["loads"]["tractions"][0]["value"] = ["0.03*t", "-0.05*t"]
    stepped = solving.solve(Parameters.model_validate(data))
    assert stepped.converged, stepped.summary["reason"]
    criteria = stepped.summary["certificate"]["criteria"]
    assert criteria["energy_balance"]["holds"]
    assert stepped.summary["strain_sets"][0]["utilisation_max"] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, math.inf])
def test_a_derivative_by_the_limit_is_that_of_differences(n: float) -> None:
    def given(limit: float) -> Parameters:
        key = "material.locking.0.at_most"
        return block(
            2, 0.25, material=material({**TEAR, "at_most": limit}), penalty__n=n,
            friction__coefficient=0.0, sensitivities={"of": ["compliance"], "to": [key]},
        )  # fmt: skip

    told = solved(given(LIMIT))["sensitivities"]["compliance"]["material.locking.0.at_most"]
    ends = [solved(given(LIMIT * factor))["compliance"] for factor in (1.001, 0.999)]
    assert told["derivative"] == pytest.approx((ends[0] - ends[1]) / (0.002 * LIMIT), rel=2e-3)


def square(dim: int, comm: MPI.Intracomm) -> cl.ContactProblem:
    """A body of the user's own that is pulled at its right side."""
    make = mesh.create_unit_square if dim == 2 else mesh.create_unit_cube
    body = make(comm, *[2] * dim)
    space = fem.functionspace(body, ("Lagrange", 1, (dim,)))
    facets = mesh.locate_entities_boundary(body, dim - 1, lambda x: np.isclose(x[0], 0.0))
    dofs = fem.locate_dofs_topological(space, dim - 1, facets)
    fixed = fem.dirichletbc(np.zeros(dim), dofs, space)
    v, x = ufl.TestFunction(space), ufl.SpatialCoordinate(body)
    right = ufl.conditional(ufl.gt(x[0], 1.0 - 1e-9), 1.0, 0.0)
    load = 0.05 * right * v[0] * ufl.ds
    return cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3), load, [fixed], [cl.LargestPrincipal(LIMIT)], []
    )


def test_python_has_the_limit_too(comm: MPI.Intracomm) -> None:
    solution = square(2, comm).solve()
    (entry,) = solution.summary["strain_sets"]
    assert entry["name"] == "largest_principal"
    assert entry["utilisation_max"] == pytest.approx(1.0, abs=1e-6)


def test_three_principal_strains_have_no_such_limit(comm: MPI.Intracomm) -> None:
    with pytest.raises(cl.InputError, match="semidefinite cone"):
        square(3, comm)


@pytest.mark.serial
def test_a_limit_that_draws_together_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The body tears and is not crushed: a multiplier with a negative eigenvalue breaks the law."""

    def tampered(state: Any, *more: Any) -> Any:
        state.body.locking_parts[1].x.array.reshape(-1, 4)[:, [0, 3]] -= 0.01
        return certify(state, *more)

    monkeypatch.setattr(of_study, "certify", tampered)
    summary = solving.solve(block(2, 0.25, material=material(TEAR), penalty__n=1e3)).summary
    assert not summary["certificate"]["criteria"]["locking_violation"]["holds"]
