"""The derivatives by all values of a function, against differences of solves and of equations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

import contact_locking as cl
from contact_locking.arrays import FloatArray
from contact_locking.inverse.derivatives import Frozen, along

QUANTITIES = ("compliance", "elastic_energy", "contact_force.1", "reactions.bcs.0.1")
SHARP = cl.Settings(tolerance=1e-10, friction_tolerance=1e-11)


def square(degree: int = 1) -> tuple[fem.FunctionSpace, fem.Function, fem.DirichletBC, cl.Contact]:
    """A square's space, the function that holds its left side, and the contact below it."""
    body = mesh.create_unit_square(MPI.COMM_WORLD, 4, 4)
    space = fem.functionspace(body, ("Lagrange", degree, (2,)))
    left = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[0], 0.0))
    bottom = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], 0.0))
    held = fem.Function(space)
    clamp = fem.dirichletbc(held, fem.locate_dofs_topological(space, 1, left))
    friction = cl.Coulomb(0.3, cl.Convolution(0.4))
    return space, held, clamp, cl.Contact(bottom, friction=friction, gap=0.002)


def fields_of_a_block() -> tuple[cl.ContactProblem, dict[str, fem.Function]]:
    """A block whose data are functions, pressed onto its foundation."""
    space, held, clamp, contact = square()
    given = {
        "E": fem.Function(fem.functionspace(space.mesh, ("DG", 0))),
        "M": fem.Function(fem.functionspace(space.mesh, ("Lagrange", 1))),
        "swelling": fem.Function(fem.functionspace(space.mesh, ("Lagrange", 1))),
        "load": fem.Function(space),
        "held": held,
    }
    given["E"].interpolate(lambda x: 1.0 + 0.3 * x[0])
    given["M"].interpolate(lambda x: 0.03 + 0.01 * x[1])
    given["swelling"].interpolate(lambda x: 0.002 + 0.001 * x[0])
    given["load"].interpolate(lambda x: (0.02 + 0.0 * x[0], -0.05 - 0.02 * x[0]))
    problem = cl.ContactProblem(
        cl.Elasticity(
            young=given["E"], poisson=0.3, eigenstrain=given["swelling"] * ufl.Identity(3)
        ),
        ufl.inner(given["load"], ufl.TestFunction(space)) * ufl.dx,
        [clamp],
        [cl.StrainBall(given["M"])],
        [contact],
        space=space,
        settings=SHARP,
    )
    return problem, given


def block_of_one_field(degree: int, n: float) -> tuple[cl.ContactProblem, fem.Function]:
    """A block whose forms, of cells and facets, and whose limits read one function."""
    space, _, clamp, contact = square(degree)
    field = fem.Function(fem.functionspace(space.mesh, ("Lagrange", 1)))
    field.interpolate(lambda x: 1.0 + 0.3 * x[0])
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    strain, change = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))
    stress = field**2 * (0.6 * ufl.tr(strain) * ufl.Identity(2) + 0.8 * strain)
    down = fem.Constant(space.mesh, (0.02, -0.05))
    limits: list[Any] = [cl.Deviator(0.03 * field), cl.Volume(at_least=-0.02 * field)]
    problem = cl.ContactProblem(
        ufl.inner(stress, change) * ufl.dx,
        ufl.inner(down, v) * ufl.dx - 0.01 * field * v[1] * ufl.ds,
        [clamp],
        limits,
        [contact],
        n=n,
        settings=SHARP,
    )
    return problem, field


def owned(field: fem.Function) -> FloatArray:
    """The values of this rank."""
    return field.x.array[: field.x.block_size * field.x.index_map.size_local]


@pytest.mark.parametrize("name", ["E", "M", "swelling", "load", "held"])
def test_a_function_has_a_field_of_derivatives(name: str) -> None:
    """Its sum with a random direction is the difference of two solves along the direction."""
    problem, fields = fields_of_a_block()
    given, random = fields[name], np.random.default_rng(3)
    solution = problem.solve()
    found = [solution.derivative(quantity, given) for quantity in QUANTITIES]
    lazy: Any = solution.differentiable
    # A quantity has one adjoint, with friction and refinements.
    solves = lazy.made.linear.solves
    solution.derivative("compliance", given)
    assert lazy.made.linear.solves == solves
    comm, before = problem.domain.comm, given.x.array.copy()
    direction = fem.Function(given.function_space)
    size = given.x.index_map.size_global * given.x.block_size
    scale = float(np.mean(comm.allgather(np.mean(before)))) or 0.01
    first, end = (given.x.block_size * bound for bound in given.x.index_map.local_range)
    owned(direction)[:] = scale * random.uniform(0.5, 1.5, size)[first:end]
    direction.x.scatter_forward()
    along = [comm.allreduce(float(owned(field) @ owned(direction))) for field in found]
    sides = []
    for share in (1e-3, -1e-3):
        given.x.array[:] = before + share * direction.x.array
        summary = problem.solve().summary
        values = (summary["compliance"], summary["elastic_energy"], summary["contact_force"][1])
        sides.append(np.array([*values, summary["reactions"]["bcs.0"][1]]))
    assert sides[0][2] > 0.01
    assert all(field.function_space == given.function_space for field in found)
    np.testing.assert_allclose(along, (sides[0] - sides[1]) / 2e-3, rtol=1e-3, atol=1e-6)
    problem.close()


@pytest.mark.parametrize(("degree", "n"), [(1, math.inf), (2, 1e3)])
def test_a_field_takes_three_evaluations_of_the_equations(
    degree: int, n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And each of its values is the difference of two more, that the value has moved."""
    evaluations = []
    evaluated = Frozen.equations

    def counted(frozen: Frozen) -> Any:
        evaluations.append(frozen)
        return evaluated(frozen)

    monkeypatch.setattr(Frozen, "equations", counted)
    problem, given = block_of_one_field(degree, n)
    solution = problem.solve()
    assert solution.summary["limit_used"] > 0.999
    lazy: Any = solution.differentiable
    first, end = given.x.index_map.local_range
    for quantity in (*QUANTITIES, "friction_force.0", "pressure_max"):
        lazy.made.adjoint(quantity)
        before = len(evaluations)
        found = solution.derivative(quantity, given)
        assert len(evaluations) == before + 3
        every = np.concatenate(problem.domain.comm.allgather(owned(found)))
        for place in range(0, len(every), 5):
            moved = fem.Function(given.function_space)
            owned(moved)[:] = np.arange(first, end) == place
            moved.x.scatter_forward()
            wanted = lazy.made.by(quantity, along(given, moved.x.array))
            assert every[place] == pytest.approx(wanted, rel=1e-6, abs=1e-7 * np.abs(every).max())
    problem.close()
