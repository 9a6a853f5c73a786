"""Contact with quadratic elements: control values of the trace, their weights, and their forces."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block

from contact_locking.parameters import Parameters
from contact_locking.problem.assembly import Problem, assemble
from contact_locking.problem.spaces import P2
from contact_locking.problem.trace import Trace, make_nodal
from contact_locking.results.derived import integral

#: Contact at the nodes of edges with the weights of Simpson's rule.
SIMPSON = dataclasses.replace(
    P2,
    trace=Trace(
        rules={2: {"quadrature_rule": "GLL", "quadrature_degree": 3}},
        pieces={2: P2.trace.pieces[2]},
    ),
)


def cube(**changes: Any) -> Parameters:
    return block(3, 0.5, **{"penalty__n": np.inf, **changes})


def random_field(problem: Problem) -> fem.Function:
    """A field with the same random nodal values for every distribution."""
    field = fem.Function(problem.u.function_space)
    dim = problem.domain.dim
    waves = np.random.default_rng(7).normal(size=(3, dim, dim)) * 9.0
    field.interpolate(lambda x: sum(np.sin(wave @ x[:dim]) for wave in waves))
    return field


def facet_values(problem: Problem, values: fem.Function) -> Any:
    """``max values`` over points of Gamma_C on a fine lattice of every facet; collective."""
    (contact,) = problem.contacts
    mesh = problem.domain.mesh
    measure = problem.domain.ds(contact.on, None, quadrature_degree=14)
    return integral(problem.domain, ufl.max_value(values - contact.gap, 0.0) ** 2 * measure), mesh


@pytest.mark.parametrize("dim", [2, 3])
def test_the_weights_are_the_integrals_of_the_control_functions(
    dim: int, comm: MPI.Intracomm
) -> None:
    problem = assemble(block(dim, 0.5), comm, element=P2)
    (contact,) = problem.contacts
    surface = contact.surface
    assert np.all(surface.weights > 0.0)
    assert surface.integral(np.ones(len(surface.nodes))) == pytest.approx(1.0)
    field = random_field(problem)
    summed = surface.integral(surface.limited.of_function(field))
    measure = problem.domain.ds(contact.on, None)
    exact = [integral(problem.domain, component * measure) for component in ufl.split(field)]
    assert summed == pytest.approx(exact, rel=1e-12)
    problem.close()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_control_values_in_ufl_are_those_of_the_matrix(dim: int, comm: MPI.Intracomm) -> None:
    problem = assemble(block(dim, 0.5), comm, element=P2)
    (contact,) = problem.contacts
    field = random_field(problem)
    limited = contact.surface.limited
    by_form = contact.surface.average(limited.of(field))()
    assert by_form == pytest.approx(limited.of_function(field), abs=1e-12)
    problem.close()


@pytest.mark.parametrize("dim", [2, 3])
def test_nodal_values_have_the_control_values_that_they_were_made_from(
    dim: int, comm: MPI.Intracomm
) -> None:
    problem = assemble(block(dim, 0.5), comm, element=P2)
    (contact,) = problem.contacts
    surface = contact.surface
    wanted = np.cos(20.0 * surface.points)
    field = surface.vector_function(wanted)
    make_nodal(field, [surface.limited])
    assert surface.limited.of_function(field) == pytest.approx(wanted, abs=1e-14)
    problem.close()


@pytest.mark.parametrize("dim", [2, 3])
def test_affine_fields_are_their_control_values(dim: int, comm: MPI.Intracomm) -> None:
    problem = assemble(block(dim, 0.5), comm, element=P2)
    surface = problem.contacts[0].surface
    field = fem.Function(problem.u.function_space)
    field.interpolate(lambda x: x[:dim])
    assert surface.limited.of_function(field) == pytest.approx(surface.points, abs=1e-15)
    problem.close()
