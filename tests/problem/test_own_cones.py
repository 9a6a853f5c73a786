"""A set of strains of one's own is one object in UFL, for every solver and every n."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block

from contact_locking.problem.strain_sets import HalfSpaceSet, NormSet
from contact_locking.results.solution import StudySolution
from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import StudyProblem, assemble

pytestmark = pytest.mark.serial

LIMIT = 0.01


def with_shape_limited(n: float, comm: MPI.Intracomm) -> StudyProblem:
    """``|eps - tr(eps)/2 I| <= LIMIT`` in the plane, beside the limit of the strain itself."""
    parameters = block(2, 0.2, material__locking_limit=0.015, penalty__n=n)
    problem = assemble(parameters, comm)
    inverse = fem.Function(problem.data.inverse_limit.function_space)
    inverse.x.array[:] = 1.0 / LIMIT
    shape = NormSet("shape", inverse, ufl.dev, ufl.dev, least=0.0)
    problem.data = dataclasses.replace(problem.data, limits=(shape,))
    return problem


def largest_change_of_shape(solution: StudySolution) -> float:
    (entry,) = solution.summary["strain_sets"]
    assert entry["name"] == "shape"
    return LIMIT * float(entry["utilisation_max"])


def test_an_own_set_of_strains_is_kept_by_the_inequality(comm: MPI.Intracomm) -> None:
    solution = solve_assembled(with_shape_limited(np.inf, comm))
    assert solution.converged, solution.summary["reason"]
    assert largest_change_of_shape(solution) == pytest.approx(LIMIT, rel=1e-6)
    assert solution.summary["strain_norm_max"] <= 0.015 * (1.0 + 1e-6)


def test_an_own_half_space_is_kept(comm: MPI.Intracomm) -> None:
    problem = assemble(block(2, 0.2, penalty__n=np.inf), comm)
    inverse = fem.Function(problem.data.inverse_limit.function_space)
    inverse.x.array[:] = 1.0 / LIMIT
    shear = ufl.as_tensor([[0.0, 0.5**0.5], [0.5**0.5, 0.0]])
    only_one_way = HalfSpaceSet("shear", inverse, shear)
    problem.data = dataclasses.replace(problem.data, limits=(only_one_way,))
    solution = solve_assembled(problem)
    assert solution.converged, solution.summary["reason"]
    (entry,) = solution.summary["strain_sets"]
    assert entry["utilisation_max"] == pytest.approx(1.0, abs=1e-6)
