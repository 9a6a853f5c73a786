"""Problems on the user's own mesh and forms, beside the same problems from a study file."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from problems import block

import contact_locking as cl
from contact_locking.mesh.domain import Domain
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled

LIMITS = (cl.StrainBall(0.02),)
PULL = {2: (0.03, -0.05), 3: (0.03, 0.0, -0.05)}
Make = Callable[[Domain, fem.FunctionSpace], cl.ContactProblem]


def strain(u: Any) -> Any:
    return ufl.sym(ufl.grad(u))


def stress(eps: Any, young: Any = 1.0, poisson: Any = 0.3) -> Any:
    shear = young / (2.0 * (1.0 + poisson))
    bulk = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    return bulk * ufl.tr(eps) * ufl.Identity(eps.ufl_shape[0]) + 2.0 * shear * eps


def elastic(space: fem.FunctionSpace, **moduli: Any) -> ufl.Form:
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    return ufl.inner(stress(strain(u), **moduli), strain(v)) * ufl.dx


def pulled(domain: Domain, space: fem.FunctionSpace, load: Any = None) -> ufl.Form:
    load = fem.Constant(domain.mesh, PULL[domain.dim]) if load is None else load
    return ufl.inner(load, ufl.TestFunction(space)) * domain.ds(("top",))


def clamped(domain: Domain, space: fem.FunctionSpace, name: str = "left") -> fem.DirichletBC:
    facets = domain.facets((name,))
    dofs = fem.locate_dofs_topological(space, domain.dim - 1, facets)
    return fem.dirichletbc(np.zeros(domain.dim), dofs, space)


def rubbing(kernel: Any = None) -> cl.Coulomb:
    return cl.Coulomb(0.3, kernel or cl.Convolution(0.3))


def own(
    *,
    a: Callable[[fem.FunctionSpace], Any] = elastic,
    contact: Callable[[Any], cl.Contact] | None = None,
    limits: Any = LIMITS,
    supports: Callable[[Domain], list[Any]] = lambda domain: [],
    **more: Any,
) -> Make:
    def make(domain: Domain, space: fem.FunctionSpace) -> cl.ContactProblem:
        on = domain.facets(("bottom",))
        touching = contact(on) if contact else cl.Contact(on, friction=rubbing())
        held = supports(domain) or [clamped(domain, space)]
        loads = pulled(domain, space)
        return cl.ContactProblem(a(space), loads, held, limits, [touching], **more)

    return make


def roller(domain: Domain) -> list[Any]:
    return [cl.Support(domain.facets(("left",))), cl.Support(domain.facets(("right",)), (1.0, 0.2))]


def both_sides(data: Any, make: Make) -> tuple[cl.Solution, cl.Solution]:
    """The solutions of a study and of the same problem in Python."""
    study = assemble(data, MPI.COMM_WORLD)
    problem = make(study.domain, study.u.function_space)
    found, expected = problem.solve(), solve_assembled(study)
    problem.close()
    return found, expected


FORCE = {"foundation": {"half_space": {"point": [0, 0], "normal": [0, 1]}, "force": [0, 0.02]}}
SIDES: dict[str, tuple[Any, Make]] = {
    "penalty": (block(h=0.25, friction__smoothing__radius=0.3), own(n=1e3)),
    "three dimensions": (
        block(3, h=0.5, friction__smoothing={"kernel": "none"}, penalty__n=math.inf),
        own(contact=lambda on: cl.Contact(on, friction=rubbing(cl.Local()))),
    ),
    "filter": (
        block(h=0.25, friction__smoothing={"kernel": "helmholtz", "radius": 0.3}),
        own(contact=lambda on: cl.Contact(on, friction=rubbing(cl.Helmholtz(0.3))), n=1e3),
    ),
    "supports": (
        block(
            h=0.25,
            loads__displacements=[],
            loads__supports=[
                {"on": "left", "along": "normal"},
                {"on": "right", "along": [1, 0.2]},
            ],
            friction__smoothing__radius=0.3,
        ),
        own(supports=roller, n=1e3),
    ),
    "force": (
        block(h=0.25, contact=FORCE, friction__smoothing__radius=0.3),
        own(
            contact=lambda on: cl.Contact(
                on, cl.Foundation(cl.HalfSpace((0, 0), (0, 1)), force=(0.0, 0.02)), rubbing()
            ),
            n=1e3,
        ),
    ),
    "revolution": (
        block(
            h=0.25,
            mesh__axisymmetric=True,
            loads__displacements=[{"on": "right", "value": [0, 0]}],
            friction__smoothing__radius=0.3,
        ),
        own(
            a=lambda space: cl.Elasticity(young=1.0, poisson=0.3),
            supports=lambda domain: [
                cl.Support(domain.facets(("right",)), (1.0, 0.0)),
                cl.Support(domain.facets(("right",)), (0.0, 1.0)),
            ],
            axisymmetric=True,
            n=1e3,
        ),
    ),
}

# The kinds of problems that ranks assemble in their own ways.
ON_RANKS = ("penalty", "three dimensions", "filter", "supports", "force")


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=() if case in ON_RANKS else pytest.mark.serial) for case in SIDES],
)
def test_python_and_the_study_file_have_the_same_solution(case: str) -> None:
    found, expected = both_sides(*SIDES[case])
    assert found.converged and expected.converged, found.summary["reason"]
    assert len(found.summary["warnings"]) == len(expected.summary["warnings"])
    u, reference = found.displacement.x.array, expected.displacement.x.array
    size = MPI.COMM_WORLD.allreduce(np.abs(reference).max(initial=0.0), op=MPI.MAX)
    assert size > 1e-3
    assert np.allclose(u, reference, rtol=0.0, atol=1e-9 * size)
    for name in ("contact_force", "friction_force", "elastic_energy", "locked_fraction"):
        assert found.summary[name] == pytest.approx(expected.summary[name], rel=1e-6, abs=1e-10)
    assert set(found.summary["certificate"]["criteria"]) == set(
        expected.summary["certificate"]["criteria"]
    )


LOADS: dict[str, Any] = {
    "body_force": [0.0, "-0.01*(1 + y)"],
    "forces": [{"on": "top", "value": [0.002, "-0.04*t"]}],
    "tractions": [{"on": "top", "value": [0.0, "-0.02*t*exp(-((x - 0.43)/0.05)**2)"]}],
    "pressures": [{"on": ["right"], "value": "0.01*y*t"}],
    "springs": [{"on": "right", "stiffness": "0.2 + y", "along": "normal"}],
    "displacements": [{"on": "left", "value": ["-0.001*t", None]}],
    "supports": [{"on": "left", "along": [0.0, 1.0], "value": "-0.002*t*y"}],
}


def test_loads_and_springs_of_a_script_are_those_of_the_study_file() -> None:
    """In steps, with a traction that is narrower than a facet."""
    times = [0.5, 1.0]
    study = assemble(
        block(h=0.25, loads=LOADS, friction__smoothing__radius=0.3, steps={"times": times}),
        MPI.COMM_WORLD,
    )
    kinds: Any = {"forces": cl.TotalForce, "tractions": cl.Traction, "pressures": cl.Pressure}
    loads = [kind(**item) for name, kind in kinds.items() for item in LOADS[name]]
    problem = cl.ContactProblem(
        cl.Elasticity(),
        None,
        [cl.Displacement(**LOADS["displacements"][0]), cl.Support(**LOADS["supports"][0])],
        [cl.StrainBall(0.02)],
        [cl.Contact("bottom", friction=rubbing())],
        loads=[cl.BodyForce(LOADS["body_force"]), *loads],
        springs=[cl.Spring(**LOADS["springs"][0])],
        space=study.u.function_space,
        tags=study.domain.facet_tags,
        names={name: tag for name, (tag,) in study.domain.facet_names.items()},
        n=study.penalty.n,
    )
    *_, last = cl.Process(problem, times)
    found, expected = last.summary, solve_assembled(study).summary
    assert found["contact_force"][1] > 0.01
    for name in ("contact_force", "friction_force", "compliance"):
        assert found[name] == pytest.approx(expected[name], rel=1e-10, abs=1e-12), name
    for name, force in expected["reactions"].items():
        assert found["reactions"][name] == pytest.approx(force, rel=1e-10, abs=1e-12), name
    problem.close()


@pytest.mark.serial
def test_a_load_is_a_number_a_text_a_function_or_ufl_and_changes_between_solves() -> None:
    space = square(4)
    body, constant = space.mesh, fem.Constant(space.mesh, (0.0, -0.01))
    x = ufl.SpatialCoordinate(body)
    nodal = fem.Function(fem.functionspace(body, ("Lagrange", 1)))
    nodal.interpolate(lambda x: 0.01 + 0.0 * x[0])
    loads: list[Any] = [
        cl.Traction("top", (0.0, -0.01)),
        cl.Traction("top", constant),
        cl.Traction("top", ufl.as_vector([0.0 * x[0], -0.01 + 0.0 * x[0]])),
        cl.Traction("top", ["0", "-0.01 + 0*x"]),
        cl.Pressure("top", nodal),
        cl.Pressure("top", lambda x: 0.01 + 0.0 * x[0]),
        cl.TotalForce("top", constant),
    ]
    found = []
    for load in loads:
        names = {"sole": 1, "wall": 2, "top": 3}
        problem = pressed(space, None, names=names, loads=[load])
        found.append(problem.solve(certificate=False).summary["contact_force"][1])
        if load.value is loads[-1].value:
            constant.value[1] = -0.02
            twice = problem.solve(certificate=False).summary["contact_force"][1]
            assert twice == pytest.approx(2.0 * found[0], rel=1e-8)
        problem.close()
    assert found == pytest.approx([0.01] * len(found), rel=1e-8)


def square(divisions: int = 8) -> fem.FunctionSpace:
    body = mesh.create_unit_square(MPI.COMM_WORLD, divisions, divisions)
    return fem.functionspace(body, ("Lagrange", 1, (2,)))


def side(body: mesh.Mesh, axis: int, value: float) -> Any:
    return mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[axis], value))


def tagged(body: mesh.Mesh) -> mesh.MeshTags:
    """The bottom has the tag 1, the left side 2 and the top 3."""
    sides = [side(body, 1, 0.0), side(body, 0, 0.0), side(body, 1, 1.0)]
    values = np.repeat(np.arange(1, 4, dtype=np.int32), [len(one) for one in sides])
    facets = np.concatenate(sides)
    order = np.argsort(facets)
    return mesh.meshtags(body, 1, facets[order], values[order])


def pressed(space: fem.FunctionSpace, load: Any, **more: Any) -> cl.ContactProblem:
    """A block between its foundation and a load on its top, guided on the left."""
    body = space.mesh
    tags = tagged(body)
    ds = ufl.Measure("ds", body, subdomain_data=tags)
    given: dict[str, Any] = {
        "a": elastic(space),
        "L": load and ufl.inner(load, ufl.TestFunction(space)) * ds(3),
        "bcs": [cl.Support("wall")],
        "limits": [cl.StrainBall(0.02)],
        "contacts": [cl.Contact("sole", friction=cl.Coulomb(0.2, cl.Convolution(0.3)))],
        "tags": tags,
        "names": {"sole": 1, "wall": 2},
    }
    return cl.ContactProblem(**(given | more))


@pytest.mark.serial
def test_each_solution_keeps_its_own_displacement_and_state() -> None:
    space = square()
    load = fem.Constant(space.mesh, (0.0, -0.01))
    problem = pressed(space, load)
    first = problem.solve()
    before = first.displacement.x.array.copy()
    load.value = (0.0, -0.02)
    second = problem.solve(after=first)
    assert np.array_equal(first.displacement.x.array, before)
    assert np.array_equal(first.state.saved.displacement, before)
    assert not np.allclose(second.displacement.x.array, before)
    problem.close()


@pytest.mark.serial
def test_an_affine_stress_expands_the_body_without_a_load() -> None:
    """``sigma = C(eps - a T I)``: a body that nothing holds back has the strain ``a T I``."""
    space = square(4)
    heat = fem.Constant(space.mesh, 0.004)
    thermal = cl.Elasticity(stress=lambda eps: stress(eps) - heat * stress(ufl.Identity(2)))
    rollers = [cl.Support(side(space.mesh, 0, 0.0)), cl.Support(side(space.mesh, 1, 0.0))]
    problem = cl.ContactProblem(thermal, bcs=rollers, space=space, limits=[cl.StrainBall(1.0)])
    for warm in (0.004, 0.008):
        heat.value = warm
        found = problem.solve()
        x = space.tabulate_dof_coordinates()[:, :2]
        assert found.converged
        assert np.allclose(found.displacement.x.array.reshape(-1, 2), warm * x, atol=1e-8)
        assert np.abs(found.elastic_stress.x.array).max(initial=0.0) < 1e-8
    problem.close()


def test_a_form_on_subdomains_is_the_elasticity_of_all_of_them() -> None:
    space = square(4)
    body = space.mesh
    count = body.topology.index_map(2)
    cells = np.arange(count.size_local + count.num_ghosts, dtype=np.int32)
    stiff = mesh.compute_midpoints(body, 2, cells)[:, 0] > 0.5
    marks = mesh.meshtags(body, 2, cells, np.where(stiff, 2, 1).astype(np.int32))
    dx = ufl.Measure("dx", body, subdomain_data=marks)
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    a = ufl.inner(stress(strain(u)), strain(v)) * dx(1)
    a += ufl.inner(stress(strain(u), young=3.0), strain(v)) * dx(2)
    young = fem.Function(fem.functionspace(body, ("DG", 0)))
    young.x.array[:] = np.where(stiff, 3.0, 1.0)
    load = fem.Constant(body, (0.0, -0.02))
    found = []
    for given in (a, cl.Elasticity(young=young, poisson=0.3)):
        problem = pressed(space, load, a=given)
        found.append(problem.solve())
        problem.close()
    assert found[0].converged
    one, other = (solution.displacement.x.array for solution in found)
    assert np.allclose(one, other, rtol=0.0, atol=1e-9)
    energies = [solution.summary["certificate"]["constants"]["alpha"] for solution in found]
    assert energies == pytest.approx([1.0 / 1.3] * 2)


@pytest.mark.serial
def test_data_of_a_body_are_numbers_texts_functions_or_ufl() -> None:
    """In all of these forms an eigenstrain and the moduli give one displacement."""
    space = square(4)
    x = ufl.SpatialCoordinate(space.mesh)
    warm = cl.Eigenstrain(expansion=fem.Constant(space.mesh, 0.02), temperature=lambda x: x[0])
    wholes = [0.02 * x[0], 0.02 * x[0] * ufl.Identity(3), "0.02*x", ["0.02*x"] * 3, warm]
    wholes.append(lambda x: np.multiply.outer(0.02 * x[0], np.eye(3)))
    moduli = [1.0 + x[1], "1 + y", lambda x: 1.0 + x[1], lambda x: 1.0 + x[1], "1+y", "y + 1"]
    rollers = [cl.Support(side(space.mesh, 0, 0.0)), cl.Support(side(space.mesh, 1, 0.0))]
    found = []
    for young, whole in zip(moduli, wholes, strict=True):
        law = cl.Elasticity(young, 0.3, eigenstrain=whole)
        problem = cl.ContactProblem(law, bcs=rollers, space=space, limits=[cl.StrainBall(0.02)])
        found.append(problem.solve(certificate=False).displacement.x.array)
        problem.close()
    assert np.abs(found[0]).max() > 0.005
    assert all(np.allclose(one, found[0], atol=1e-9) for one in found)


@pytest.mark.serial
def test_a_mesh_of_second_order_is_refused() -> None:
    element = basix.ufl.element("Lagrange", "triangle", 2, shape=(2,))
    nodes = np.array([(0, 0), (1, 0), (0, 1), (0.5, 0.5), (0, 0.5), (0.5, 0)], dtype=float)
    cells = np.arange(6, dtype=np.int64)[None]
    curved = mesh.create_mesh(comm=MPI.COMM_SELF, cells=cells, x=nodes, e=ufl.Mesh(element))
    space = fem.functionspace(curved, ("Lagrange", 2, (2,)))
    with pytest.raises(cl.InputError, match="setOrder") as caught:
        cl.ContactProblem(cl.Elasticity(young=1.0, poisson=0.3), space=space)
    assert caught.value.key == "mesh"


@pytest.mark.serial
def test_a_body_that_its_loads_alone_press_may_have_loads_later(comm: MPI.Intracomm) -> None:
    square = mesh.create_unit_square(comm, 6, 6)
    space = fem.functionspace(square, ("Lagrange", 1, (2,)))
    load = fem.Constant(square, (0.0, 0.0))
    L = ufl.inner(load, ufl.TestFunction(space)) * ufl.dx
    bottom = mesh.locate_entities_boundary(square, 1, lambda x: np.isclose(x[1], 0.0))
    contact = cl.Contact(bottom, cl.HalfSpace((0, 0), (0, 1)), friction=rubbing())
    problem = cl.ContactProblem(elastic(space), L, contacts=[contact])
    load.value[:] = (0.01, -0.1)
    found = problem.solve()
    assert found.converged
    assert found.summary["contact_force"] == pytest.approx([0.0, 0.1], rel=1e-6)
    assert found.summary["friction_force"] == pytest.approx([-0.01, 0.0], abs=1e-8)
    load.value[:] = (0.1, -0.1)
    assert not problem.solve().converged
    load.value[:] = (0.0, 0.1)
    with pytest.raises(cl.InputError, match="do not press the body"):
        problem.solve()
    problem.close()


def held_by_form(terms: Callable[[Domain, Any, Any], ufl.Form]) -> cl.Solution:
    """A block that a force lifts off its foundation, held by terms of ``a`` alone."""
    study = assemble(block(h=0.5), MPI.COMM_WORLD)
    domain, space = study.domain, study.u.function_space
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    load = fem.Constant(domain.mesh, (0.02, 0.02))
    contact = cl.Contact(domain.facets(("bottom",)), friction=rubbing())
    problem = cl.ContactProblem(
        elastic(space) + terms(domain, u, v), pulled(domain, space, load), [], LIMITS, [contact]
    )
    found = problem.solve()
    problem.close()
    return found


@pytest.mark.serial
@pytest.mark.parametrize("place", ["facets", "cells"])
def test_terms_of_a_form_with_the_displacement_itself_hold_the_body(place: str) -> None:
    def springs(domain: Domain, u: Any, v: Any) -> ufl.Form:
        measure = domain.ds(("top",)) if place == "facets" else ufl.dx
        return 0.5 * ufl.inner(u, v) * measure

    found = held_by_form(springs)
    assert found.converged
    parts = found.summary["certificate"]["resultants"]
    assert parts["loads"] == pytest.approx([0.02, 0.02])
    assert np.add(parts["loads"], parts["contact"]) == pytest.approx(-np.array(parts["reactions"]))
