"""Problems on the user's own mesh and forms, beside the same problems from a study file."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block

import contact_locking as cl
from contact_locking.mesh.domain import Domain
from contact_locking.process.solving import solve_assembled
from contact_locking.study.assembly import assemble

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


N = {"n": 1e3}
FORCE = {"foundation": {"half_space": {"point": [0, 0], "normal": [0, 1]}, "force": [0, 0.02]}}
SIDES: dict[str, tuple[Any, Make]] = {
    "penalty": (block(h=0.25, friction__smoothing__radius=0.3), own(n=1e3)),
    "inequality": (
        block(h=0.25, penalty__n=math.inf, friction__smoothing__radius=0.3),
        own(),
    ),
    "three dimensions": (
        block(3, h=0.5, friction__smoothing={"kernel": "none"}, penalty__n=math.inf),
        own(contact=lambda on: cl.Contact(on, friction=rubbing(cl.Local()))),
    ),
    "elasticity": (
        block(h=0.25, friction__smoothing__radius=0.3),
        own(a=lambda space: cl.Elasticity(young=1.0, poisson=0.3), n=1e3),
    ),
    "filter": (
        block(h=0.25, friction__smoothing={"kernel": "helmholtz", "radius": 0.3}),
        own(contact=lambda on: cl.Contact(on, friction=rubbing(cl.Helmholtz(0.3))), n=1e3),
    ),
    "ball": (
        block(
            h=0.25,
            contact={"foundation": {"sphere": {"centre": [0.5, -2.01], "radius": 2.0}}},
            friction__smoothing__radius=0.3,
        ),
        own(
            contact=lambda on: cl.Contact(on, cl.Sphere((0.5, -2.01), 2.0), rubbing()),
            n=1e3,
        ),
    ),
    "gap": (
        block(h=0.25, contact={"gap": "0.01*x"}, friction__smoothing__radius=0.3),
        own(
            contact=lambda on: cl.Contact(on, cl.Gap(lambda x: 0.01 * x[0]), rubbing()),
            n=1e3,
        ),
    ),
    "quadratic": (
        block(h=0.5, discretisation__degree=2, friction__smoothing__radius=0.6),
        own(
            contact=lambda on: cl.Contact(on, friction=rubbing(cl.Convolution(0.6))),
            n=1e3,
        ),
    ),
    "sets": (
        block(
            h=0.25,
            material={
                "locking": [
                    {"norm": "deviator", "at_most": 0.03},
                    {"norm": "volume", "at_most": 0.01, "at_least": -0.02},
                    {"norm": "direction", "along": [1, 1], "at_most": 0.02},
                    {
                        "norm": "weighted",
                        "matrix": [[1, 0, 0], [0, 2, 0], [0, 0, 1]],
                        "at_most": 0.05,
                    },
                ]
            },
            friction__smoothing__radius=0.3,
        ),
        own(
            limits=[
                cl.Deviator(0.03),
                cl.Volume(at_most=0.01, at_least=-0.02),
                cl.Direction((1.0, 1.0), at_most=0.02),
                cl.Weighted(np.diag([1.0, 2.0, 1.0]), 0.05),
            ],
            n=1e3,
        ),
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
                on, cl.HalfSpace((0, 0), (0, 1)), rubbing(), force=cl.Force((0.0, 0.02))
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


@pytest.mark.parametrize("case", SIDES)
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
