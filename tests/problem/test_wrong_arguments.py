"""Arguments of another kind than a contact problem takes are refused, and the message says why."""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI

import contact_locking as cl

pytestmark = pytest.mark.serial

FLOOR = cl.HalfSpace((0.0, 0.0), (0.0, 1.0))


@pytest.fixture(scope="module")
def space() -> fem.FunctionSpace:
    return fem.functionspace(mesh.create_unit_square(MPI.COMM_WORLD, 4, 4), ("Lagrange", 1, (2,)))


def pressed(space: fem.FunctionSpace, **given: Any) -> cl.ContactProblem:
    """A block whose top goes down; ``given`` are arguments of its contact, or of the problem."""
    body = space.mesh
    sides = [
        mesh.locate_entities_boundary(body, 1, lambda x, y=y: np.isclose(x[1], y))
        for y in (0.0, 1.0)
    ]
    top = fem.locate_dofs_topological(space, 1, sides[1])
    down = fem.dirichletbc(np.array([0.0, -0.01]), top, space)
    names = ("on", "foundation", "friction", "gap", "mu")
    of_contact = {"on": sides[0]} | {key: given.pop(key) for key in names if key in given}
    problem = {
        "a": cl.Elasticity(young=1.0, poisson=0.3),
        "bcs": [down],
        "contacts": [cl.Contact(**of_contact)],
        "space": space,
    }
    return cl.ContactProblem(**(problem | given))


def on(foundation: Any, space: fem.FunctionSpace) -> dict[str, Any]:
    return {"foundation": foundation}


def trial_and_test(space: fem.FunctionSpace) -> Any:
    return ufl.TrialFunction(space), ufl.TestFunction(space)


def eps(w: Any) -> Any:
    return ufl.sym(ufl.grad(w))


def stiffening(space: fem.FunctionSpace) -> Any:
    """A density that grows with the square of the trial function."""
    u, v = trial_and_test(space)
    return (1.0 + ufl.tr(eps(u))) * ufl.inner(eps(u), eps(v))


def stiffness(space: fem.FunctionSpace) -> Any:
    return ufl.inner(*map(eps, trial_and_test(space)))


def elsewhere() -> fem.FunctionSpace:
    return fem.functionspace(mesh.create_unit_square(MPI.COMM_WORLD, 3, 3), ("Lagrange", 1, (2,)))


def x(space: fem.FunctionSpace) -> Any:
    return ufl.SpatialCoordinate(space.mesh)


class Own:
    """The floor ``x[1] <= -0.002`` and faults of it."""

    def __init__(self, gap: Any = lambda y: y, normal: Any = lambda normal: normal) -> None:
        self._gap, self._normal = gap, normal

    def gap(self, x: Any) -> Any:
        return self._gap(x[1] + 0.002)

    def contact_normal(self, x: Any) -> Any:
        return self._normal(np.stack([0.0 * x[0], 0.0 * x[0] - 1.0]))


def capped(change: Callable[[Any], Any], space: fem.FunctionSpace) -> dict[str, Any]:
    """A contact whose friction bound (k,) is a function of Coulomb's."""

    class Bound(cl.FrictionBound):
        def evaluate(self, pressure: Any, slip: Any) -> Any:
            return change(super().evaluate(pressure, slip))

    class Capped(cl.Coulomb):
        def on(self, surface: Any, smoothing: Any) -> Bound:
            return Bound(surface, smoothing, self.coefficient)

    return {"foundation": FLOOR, "friction": Capped(0.3, cl.Local())}


def top(space: fem.FunctionSpace) -> Any:
    return mesh.locate_entities_boundary(space.mesh, 1, lambda x: np.isclose(x[1], 1.0))


WRONG: dict[str, tuple[Callable[[fem.FunctionSpace], dict[str, Any]], str]] = {
    "mu of UFL": (lambda space: {"friction": cl.Coulomb(0.1 + x(space)[0])}, "Coulomb.coefficient"),
    "mu below zero": (lambda space: {"friction": cl.Coulomb(-0.3)}, "Coulomb.coefficient"),
    "gap of UFL": (lambda space: {"gap": 0.01 * x(space)[0]}, "Contact.gap"),
    "radius below zero": (
        lambda space: {"foundation": cl.Sphere((0.0, -1.0), -1.0)},
        "Sphere.radius",
    ),
    "mu below zero without slip": (
        lambda space: {"friction": cl.Coulomb(lambda x, s: -0.3 + s)},
        "contacts.0.friction.coefficient",
    ),
    "mu below zero somewhere": (
        lambda space: {"friction": cl.Coulomb(lambda x, s: 0.3 - x[:, 0])},
        "contacts.0.friction.coefficient",
    ),
    # Points come to mu as (k, d), and to foundations as (d, k).
    "mu of the first point": (
        lambda space: {"friction": cl.Coulomb(lambda x, s: 0.1 + 0.2 * x[0])},
        "contacts.0.friction.coefficient",
    ),
    "level set of UFL": (lambda space: {"foundation": cl.LevelSet(x(space)[1])}, "LevelSet"),
    "motion in space": (
        lambda space: {"foundation": cl.Foundation(FLOOR, motion=(0.0, 0.0, 0.0))},
        "contacts.0.foundation.motion",
    ),
    "an argument that is none": (lambda space: {"mu": 0.3}, "Contact.mu"),
    "marks of facets": (lambda space: {"on": np.zeros(9, dtype=bool)}, "contacts.0"),
    "no facets": (lambda space: {"on": np.zeros(0, dtype=np.int32)}, "contacts.0"),
    "too large facets": (lambda space: {"on": np.array([10**6])}, "contacts.0"),
    "place by a function": (lambda space: {"on": lambda x: np.isclose(x[1], 0.0)}, "contacts.0"),
    "nonlinear a": (lambda space: {"a": stiffening(space) * ufl.dx}, "a"),
    "nonlinear a beside an energy": (
        lambda space: {
            "a": stiffening(space) * ufl.dx,
            "energy": lambda u: ufl.inner(eps(u), eps(u)) * ufl.dx,
            "n": 1e4,
        },
        "a",
    ),
    "a without measure": (lambda space: {"a": stiffening(space)}, "a"),
    "a without strains": (
        lambda space: {"a": ufl.inner(*trial_and_test(space)) * ufl.dx},
        "a",
    ),
    "a that sees rotations": (
        lambda space: {"a": ufl.inner(*map(ufl.grad, trial_and_test(space))) * ufl.dx},
        "a",
    ),
    "strains and displacements in one integral": (
        lambda space: {"a": (stiffness(space) + ufl.inner(*trial_and_test(space))) * ufl.dx},
        "a",
    ),
    "a support of no direction": (
        lambda space: {"bcs": [cl.Support(top(space), along=(0.0, 0.0))]},
        "Support.along",
    ),
    "a support in space": (
        lambda space: {"bcs": [cl.Support(top(space), along=(0.0, 0.0, 1.0))]},
        "loads.supports.0.along",
    ),
    "a support of no facets": (
        lambda space: {"bcs": [cl.Support(top(space)[:0])]},
        "loads.supports.0",
    ),
    "a load that is no number": (
        lambda space: {
            "L": fem.Constant(space.mesh, math.nan) * ufl.TestFunction(space)[1] * ufl.dx
        },
        "L",
    ),
    "a bilinear load": (lambda space: {"L": stiffness(space) * ufl.dx}, "L"),
    "n zero": (lambda space: {"n": 0.0}, "n"),
    "normal of no direction": (
        lambda space: {"foundation": cl.HalfSpace((0.0, 0.0), (0.0, 0.0))},
        "HalfSpace.normal",
    ),
    "incompressible": (
        lambda space: {"a": cl.Elasticity(young=1.0, poisson=0.5)},
        "Elasticity.poisson",
    ),
    "E below zero somewhere": (lambda space: {"a": cl.Elasticity("x - 0.5", 0.3)}, "a"),
    "E at no coordinate": (lambda space: {"a": cl.Elasticity("1 + z", 0.3)}, "a.young"),
    "no ellipticity": (
        lambda space: {"a": cl.Elasticity(lame_lambda=-3.0, lame_mu=1.0)},
        "a.lambda",
    ),
    "an eigenstrain of four numbers": (
        lambda space: {"a": cl.Elasticity(1.0, 0.3, eigenstrain=[0.1] * 4)},
        "a.eigenstrain.value",
    ),
    "two laws": (lambda space: {"a": cl.Elasticity(young=1.0, lame_mu=1.0)}, "Elasticity"),
    "M below zero somewhere": (
        lambda space: {"limits": [cl.Deviator(0.1), cl.Volume(at_least=lambda x: x[0] - 0.5)]},
        "limits.1.at_least",
    ),
    "a direction in space": (
        lambda space: {"limits": [cl.Direction([0.0, 0.0, 1.0], 0.1)]},
        "limits.0.along",
    ),
    "space of another mesh": (
        lambda space: {"L": ufl.TestFunction(elsewhere())[1] * ufl.dx},
        "space",
    ),
    "a load at no coordinate": (
        lambda space: {"loads": [cl.BodyForce((0.0, "0.1*z"))]},
        "loads.body_force.1",
    ),
    "a pressure that is lost": (
        lambda space: {"loads": [cl.Pressure(top(space), "exp(-((x - 0.43)/0.0003)**2)")]},
        "loads.pressures.0.value",
    ),
    "a spring that pushes": (
        lambda space: {"springs": [cl.Spring(top(space), "x - 0.5")]},
        "loads.springs.0.stiffness",
    ),
    "two displacements of a part": (
        lambda space: {
            "bcs": [cl.Displacement(top(space), (0.0, value)) for value in (-0.01, "-0.01*x")]
        },
        "loads.displacements.0.value.1",
    ),
    "limit alone": (lambda space: {"limits": [0.02]}, "limits"),
    "n of DOLFINx": (lambda space: {"n": fem.Constant(space.mesh, 1e4)}, "n"),
    "energy without measure": (
        lambda space: {"energy": lambda u: ufl.inner(u, u), "n": 1e4},
        "energy",
    ),
}


FAULTS: dict[str, Any] = {
    "long normals": Own(normal=lambda normal: 2.0 * normal),
    "normals that are no numbers": Own(normal=lambda normal: np.nan * normal),
    "normals by points": Own(normal=lambda normal: normal.T),
    "normals in a list": Own(normal=list),
    "normals outwards": Own(normal=lambda normal: -normal),
    "gaps in a row": Own(gap=lambda gap: gap[None]),
    "one gap for all": Own(gap=lambda gap: 0.002),
    "gaps that are no numbers": Own(gap=lambda gap: np.nan * gap),
}
BOUNDS: dict[str, Callable[[Any], Any]] = {
    "bounds in a column": lambda bound: bound[:, None],
    "one bound for all": lambda bound: 0.1,
    "bounds that are no numbers": lambda bound: np.nan * bound,
    "bounds below zero": lambda bound: -bound,
}
WRONG |= {name: (partial(on, own), "contacts.0.foundation") for name, own in FAULTS.items()}
WRONG |= {name: (partial(capped, change), "contacts.0.friction") for name, change in BOUNDS.items()}


@pytest.mark.parametrize("name", WRONG)
def test_an_argument_of_another_kind_is_refused_with_its_key(
    name: str, space: fem.FunctionSpace
) -> None:
    make, key = WRONG[name]
    with pytest.raises(cl.InputError) as caught:
        pressed(space, **make(space)).solve(certificate=False)
    assert caught.value.key == key
    assert f"This is about {key}." in "".join(traceback.format_exception(caught.value))


def test_constants_of_dolfinx_move_foundations_and_change_gap_and_friction(
    space: fem.FunctionSpace,
) -> None:
    way, gap, mu = (fem.Constant(space.mesh, value) for value in ((0.0, 0.0), 0.0, 0.0))
    floor = cl.Foundation(FLOOR, motion=cl.Motion(way))
    moving = pressed(space, foundation=floor, friction=cl.Coulomb(mu))
    standing = pressed(space, gap=gap, friction=cl.Coulomb(0.0))
    before = moving.solve(certificate=False).summary
    way.value[:], gap.value, mu.value = (0.003, 0.002), -0.002, 0.3
    after = moving.solve(certificate=False).summary
    assert before["friction_force"] == [0.0, 0.0]
    assert after["friction_force"][0] > 0.0
    assert after["contact_force"][1] == pytest.approx(1.2 * before["contact_force"][1], rel=0.1)
    pushed = standing.solve(certificate=False).summary
    mu.value, way.value[:] = 0.0, (0.0, 0.002)
    smooth = moving.solve(certificate=False).summary
    assert pushed["contact_force"] == pytest.approx(smooth["contact_force"], abs=1e-9)
    moving.close()
    standing.close()


@pytest.mark.parametrize("key", ["after", "start"])
def test_a_solve_begins_with_a_solution_alone(key: str, space: fem.FunctionSpace) -> None:
    problem = pressed(space)
    with pytest.raises(cl.InputError, match="a solution of this problem, not str") as caught:
        problem.solve(**{key: "results"})  # type: ignore[arg-type]
    assert caught.value.key == key
    problem.close()


def test_a_closed_problem_is_solved_no_more(space: fem.FunctionSpace) -> None:
    problem = pressed(space)
    problem.close()
    with pytest.raises(cl.InputError, match="closed"):
        problem.solve()


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: cl.load(None), "path"),  # type: ignore[arg-type]
        (lambda: cl.from_mapping(None), "data"),  # type: ignore[arg-type]
        (lambda: cl.solve("study.yml"), "parameters"),  # type: ignore[arg-type]
        (lambda: cl.check("study.yml"), "parameters"),  # type: ignore[arg-type]
        (lambda: cl.assemble("study.yml", MPI.COMM_WORLD), "parameters"),  # type: ignore[arg-type]
        (lambda: cl.write(None, "results"), "solution"),  # type: ignore[arg-type]
    ],
)
def test_functions_of_studies_name_the_argument_of_another_kind(
    call: Callable[[], object], key: str
) -> None:
    with pytest.raises(cl.InputError) as caught:
        call()
    assert caught.value.key == key


def test_the_distance_of_two_solutions_is_that_of_their_displacements(
    space: fem.FunctionSpace,
) -> None:
    """Under a load that doubles, u doubles too, and a(u, u) is the work of the load."""
    load = fem.Constant(space.mesh, (0.0, -0.01))
    work = ufl.inner(load, ufl.TestFunction(space)) * ufl.dx
    floor = mesh.locate_entities_boundary(space.mesh, 1, lambda x: np.isclose(x[1], 0.0))
    held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(space, 1, floor), space)
    problem = cl.ContactProblem(stiffness(space) * ufl.dx, work, [held])
    one = problem.solve()
    load.value *= 2.0
    apart = problem.solve().distance(one)
    assert one.distance(one)["energy_norm"] == 0.0
    assert apart["relative"] == pytest.approx(0.5, rel=1e-8)
    assert apart["energy_norm"] ** 2 == pytest.approx(one.summary["compliance"], rel=1e-6)
    with pytest.raises(cl.InputError, match="on the same mesh") as caught:
        one.distance(pressed(elsewhere()).solve())
    assert caught.value.key == "other"
    problem.close()
