"""The stresses of the guaranteed bound and Korn's constant, against splines and polynomials."""

from __future__ import annotations

import math
from typing import Any

import basix
import numpy as np
import pytest
from basix import CellType, ElementFamily
from bounded_block import benchmark
from dolfinx import fem
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.process.of_study import solver_of
from contact_locking.study.assembly import assemble
from contact_locking.theory.guaranteed.body import Body
from contact_locking.theory.guaranteed.boundary_conditions import held_components
from contact_locking.theory.guaranteed.contact_tractions import contact_tractions
from contact_locking.theory.guaranteed.data_oscillation import balanced_loads, korn_constants
from contact_locking.theory.guaranteed.facet_polynomials import product_integral
from contact_locking.theory.guaranteed.floating import forces_in_balance
from contact_locking.theory.guaranteed.macro_element import macro_element
from contact_locking.theory.guaranteed.triangles import Triangles

#: The points of high degrees that keep the polynomials apart.
GLL = basix.LagrangeVariant.gll_warped
#: Limits at the corners hold in whole cells.
QUADRATIC = {"degree": 2}


@pytest.mark.serial
@pytest.mark.parametrize(("degree", "free", "loads"), [(1, 9, 6), (2, 18, 18)])
def test_the_macro_element_has_the_stresses_of_c1_splines_and_balances_all_loads(
    degree: int, free: int, loads: int
) -> None:
    element = macro_element(degree)
    # The second derivatives of C1 splines of degree k + 2 on the split triangle.
    assert len(element.basis) == free
    assert len(element.lifts) == loads
    # A self-equilibrated traction does no work along translations and the rotation.
    total = element.moments[:, :, 0].sum(axis=1)
    assert np.abs(total).max() < 1e-12
    lifted = element.lift_moments[:, :, 0].sum(axis=1)
    # The divergence has one unit of mass at a point of a part of the area 1/6.
    mass = element.load_mass.sum(axis=0) / 6.0
    wanted = np.zeros((3, len(mass), 2, 2))
    wanted[:, :, [0, 1], [0, 1]] = mass[None, :, None]
    assert lifted == pytest.approx(wanted.reshape(-1, 2), abs=1e-12)


def korn_constant(corners: FloatArray, degree: int) -> float:
    """The largest ``|grad(v - r)|/|eps(v)|`` of the polynomials on a triangle, from eigenvalues."""
    element = basix.create_element(ElementFamily.P, CellType.triangle, degree, GLL)
    points, weights = basix.make_quadrature(CellType.triangle, 2 * degree)
    inverse = np.linalg.inv((corners[1:] - corners[0]).T)
    slopes = np.einsum("ji,jqn->qni", inverse, element.tabulate(1, points)[1:, :, :, 0])
    x, y = np.moveaxis(slopes, 2, 0)
    zero = np.zeros_like(x)
    # Each column is a field along x or along y.
    strains = [np.hstack(pair) for pair in ((x, zero), (zero, y), (y / 2**0.5, x / 2**0.5))]
    turn = np.hstack([-y, x]) / 2.0
    share = (weights / weights.sum())[:, None]
    turn -= np.sum(share * turn, axis=0)
    sizes, fields = np.linalg.eigh(sum(part.T @ (share * part) for part in strains))
    # The first three are the rigid motions.
    assert abs(sizes[2] / sizes[-1]) < 1e-12 < 1e-9 < sizes[3] / sizes[-1]
    fields = fields[:, 3:] / np.sqrt(sizes[3:])
    gram = fields.T @ turn.T @ (share * turn) @ fields
    return math.sqrt(1.0 + 2.0 * np.linalg.eigvalsh(gram)[-1])


@pytest.mark.serial
def test_korns_constant_of_a_triangle_is_not_below_that_of_polynomials() -> None:
    # From an equilateral triangle to needles with a flat or with a short side.
    apices = [(0.5, 0.75**0.5), (0.0, 1.0), (0.5, 0.05), (0.0, 0.05), (0.97, 0.05), (1.5, 0.1)]
    apices += list(np.random.default_rng(1).uniform([0.0, 0.1], 1.0, size=(12, 2)))
    triangles = np.array([[[0.0, 0.0], [1.0, 0.0], apex] for apex in apices])
    edges = triangles - np.roll(triangles, 1, axis=1)
    bounds = korn_constants(np.linalg.norm(edges, axis=2))
    for corners, upper in zip(triangles, bounds, strict=True):
        assert 0.5 * upper < korn_constant(corners, 6) < upper


@pytest.mark.parametrize("changes", [{}, {"discretisation": QUADRATIC}])
def test_stress_and_bars_do_the_work_of_loads_and_contact_along_every_displacement(
    changes: dict[str, Any],
) -> None:
    # The top is loaded, the right side is clamped; rollers hold the left side along y alone.
    support = [{"on": "right", "value": [0.0, 0.0]}, {"on": "left", "value": [None, 0.0]}]
    pull = [{"on": "top", "value": [-0.03, -0.05]}]
    loads = {"displacements": support, "tractions": pull, "body_force": [0.01, -0.02]}
    changes = {"material__locking_limit": 0.02, "loads": loads} | changes
    solver = solver_of(assemble(benchmark(4, **changes), MPI.COMM_WORLD))
    state = solver.state(solver.solve())
    problem = state.problem
    triangles = Triangles(problem.domain)
    element = macro_element(problem.element.degree)
    balanced = balanced_loads(problem.data, triangles, element)
    contacts = [contact_tractions(fields, triangles) for fields in state.contacts]
    body, held = Body(state, triangles, element), held_components(state, triangles)
    forces, _ = forces_in_balance(problem, triangles, element, held, balanced, contacts)
    found = body.balanced(forces, problem.u)
    bars = found.bars
    assert maximum(state.comm, np.abs(found.forces)) > 1e-3

    v = fem.Function(problem.u.function_space)
    v.interpolate(lambda x: np.stack([np.sin(3.0 * x[0] + x[1]), np.cos(x[0] - 2.0 * x[1])]))
    v.x.array[problem.constraints.dofs] = 0.0
    strains = body.strains(v, element)
    inner = np.sum(found.stress * (element.mass @ strains), axis=(1, 2, 3))
    work = state.sum(inner * triangles.areas / 3.0)
    work += state.sum(bars.work(found.forces, bars.along(strains)))
    for contact in contacts:
        normal, tangent = contact.split(v.x.array.reshape(-1, 2))
        pushed = product_integral(contact.along, tangent) - product_integral(
            contact.pressure, normal
        )
        work -= state.sum(contact.lengths * pushed)
    owned = 2 * v.function_space.dofmap.index_map.size_local
    outer = state.sum(state.system.forms.loads()[:owned] * v.x.array[:owned])
    assert work == pytest.approx(outer, rel=1e-8, abs=1e-10)
