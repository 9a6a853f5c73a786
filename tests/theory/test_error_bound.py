"""The guaranteed bound of the error: never below the error, sharp, and silent where not proved."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import ufl
from certified import certificate
from dolfinx import fem
from manufactured import Manufactured, X, Y
from mpi4py import MPI
from problems import benchmark, block, column, with_changes
from test_verification_annulus import LAME_LAMBDA, LAME_MU, annulus, exact_displacement
from transfer import on_mesh_of

from contact_locking import solve_steps
from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound
from contact_locking.fem.compiled import integral
from contact_locking.fem.spaces import P1, P2, Element
from contact_locking.problem import forms
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import SolvableStudy
from contact_locking.study_file.parameters import Parameters
from contact_locking.theory.equilibrated_stress import Body
from contact_locking.theory.stress_data import (
    balanced_forces,
    balanced_loads,
    contact_tractions,
    held_components,
)
from contact_locking.theory.triangles import Triangles, macro_element, product_integral


@dataclass(frozen=True)
class Comparison:
    """A guaranteed bound, and the energy norm of the distance to a solution on a finer mesh."""

    bound: dict[str, Any]
    distance: float

    @property
    def effectivity(self) -> float:
        return float(self.bound["energy_norm"] / self.distance)


def random_block(seed: int) -> Parameters:
    """A block on a regular grid with random material, loads, supports, gap, friction, penalty."""
    random = np.random.default_rng(seed)
    young = float(10.0 ** random.uniform(-1.0, 3.0))
    limit = float(np.round(10.0 ** random.uniform(-2.3, -1.0), 4))
    if random.random() < 0.25:
        limit = np.inf
    scale = min(limit, 0.05)
    elasticity: dict[str, Any] = {"young": young, "poisson": float(random.uniform(0.0, 0.45))}
    if random.random() < 0.3:
        diagonal = np.diag(random.uniform(0.5, 2.0, 3)) + 0.2
        elasticity = {"stiffness": (young * diagonal).tolist()}
    side = str(random.choice(["left", "right"]))
    support: dict[str, Any] = {"on": side, "value": [0.0, 0.0]}
    pull, force = (young * scale * random.uniform(-1.0, 1.0, 2) * size for size in (2.0, 0.5))
    loads: dict[str, Any] = {
        "displacements": [support],
        "tractions": [{"on": "top", "value": pull.tolist()}],
    }
    if random.random() < 0.5:
        loads["body_force"] = force.tolist()
    n = np.inf if random.random() < 0.7 else float(young * 10.0 ** random.uniform(2.0, 6.0))
    return with_changes(
        {
            "mesh": {"builder": "block", "h": 0.25, "structured": True},
            "material": {"elasticity": elasticity, "locking_limit": limit},
            "loads": loads,
            "contact": {"on": "bottom", "gap": f"{scale * random.uniform(0.0, 0.2)!r}*(1 + x)"},
            "friction": {
                "coefficient": float(random.choice([0.0, 0.3, 0.6])),
                "smoothing": {"radius": 0.3},
            },
            "penalty": {"n": n},
            "certificate": {"error_bound": True},
        }
    )


def compared(parameters: Parameters, refinement: int, element: Element = P1) -> Comparison | None:
    """The bound of a problem on a regular grid and the distance from a grid that is finer.

    None for a problem that is not solved on one of the grids.
    """
    coarse = solving.solve(parameters, MPI.COMM_SELF)
    if not coarse.converged:
        return None
    data = parameters.model_dump(by_alias=True)
    data["penalty"] = {}
    data["mesh"]["h"] /= refinement
    fine = Parameters.model_validate(data)
    problem = assemble(fine, MPI.COMM_SELF, element=element)
    keep_friction_bound(problem.contacts, coarse)
    exact = solving.solve_assembled(problem)
    if not exact.converged:
        return None
    found = coarse.summary["certificate"]["errors"]["guaranteed"]
    difference = on_mesh_of(coarse.displacement, exact.displacement)
    difference.x.array[:] -= exact.displacement.x.array
    square = integral(problem.domain, forms.elastic_form(difference, difference, problem.data))
    return Comparison(found, float(np.sqrt(square)))


def keep_friction_bound(contacts: Any, coarse: StudySolution) -> None:
    """Give contacts along the x axis the friction bound of a solution on a coarser mesh."""
    for contact, known in zip(contacts, coarse.contacts, strict=True):
        order = np.argsort(known.surface.points[:, 0])
        x, values = known.surface.points[order, 0], known.bound[order]
        fixed = np.interp(contact.surface.points[:, 0], x, values)

        class Fixed(FrictionBound):
            kept = fixed

            def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
                return self.kept.copy()

        old = contact.friction
        contact.friction = Fixed(contact.surface, old.smoothing, old.law, old.frictionless)


#: A displacement that vanishes on all sides but the bottom, along which it is.
SHEAR = (X * (1 - X) * (1 - Y) / 5, 0 * X)
#: Limits at the corners hold in whole cells.
QUADRATIC = {"degree": 2}


def bound(parameters: Parameters) -> dict[str, Any]:
    return dict(certificate(parameters)["errors"]["guaranteed"])


@pytest.mark.parametrize(("pressure", "most"), [(None, 1.0 + 1e-9), ((1 + X) / 10, 1.6)])
def test_the_bound_of_a_manufactured_solution_is_sharp_and_never_below_the_error(
    pressure: Any, most: float
) -> None:
    # The body force is affine, and the traction quadratic, which stresses of degree 2 balance.
    exact = Manufactured(SHEAR, pressure, pressure, n=math.inf, epsilon=0.0, element=P2)
    solution = exact.solved(0.125, certificate__error_bound=True)
    found = solution.summary["certificate"]["errors"]["guaranteed"]
    assert 1.0 - 1e-9 <= found["energy_norm"] / exact.errors(solution).energy <= most


def annulus_error(solution: StudySolution) -> float:
    """The energy norm of the error against the exact solution of V10; collective."""
    mesh = solution.domain.mesh
    eps = ufl.sym(ufl.grad(solution.displacement - exact_displacement(mesh)))
    energy = LAME_LAMBDA * ufl.tr(eps) ** 2 + 2.0 * LAME_MU * ufl.inner(eps, eps)
    return math.sqrt(mesh.comm.allreduce(fem.assemble_scalar(fem.form(energy * ufl.dx))))


@pytest.mark.serial
def test_v10_the_bound_covers_the_error_in_a_ring_that_locks() -> None:
    for h in (0.2, 0.1):
        solution = annulus(h, math.inf, certificate__error_bound=True)
        found = solution.summary["certificate"]["errors"]["guaranteed"]
        # The exact solution is that of the circles, the bound that of the polygon.
        assert 1.2 < found["energy_norm"] / annulus_error(solution) < 2.6


@pytest.mark.serial
@pytest.mark.parametrize("seed", [0, 2])
def test_the_bound_of_a_random_problem_is_not_below_the_distance_to_a_finer_mesh(
    seed: int,
) -> None:
    found = compared(random_block(seed), 4)
    assert found is not None and found.bound["applicable"]
    assert found.effectivity > 1.0


def pressed_column(pressure: float, n: float) -> dict[str, Any]:
    """The bound for a column between rollers, on its lower side too."""
    rollers = [
        {"on": ["left", "right"], "value": [0.0, None]},
        {"on": "bottom", "value": [None, 0]},
    ]
    given: dict[str, Any] = {"loads__displacements": rollers, "contact": {"on": []}}
    given["penalty"] = {"n": n}
    return bound(column(pressure=pressure, certificate__error_bound=True, **given))


@pytest.mark.parametrize("pressure", [0.01, 0.05])
def test_the_bound_of_a_column_that_is_exact_is_the_tolerance_of_the_solver(
    pressure: float,
) -> None:
    # The column is elastic for the one pressure and locked for the other.
    found = pressed_column(pressure, math.inf)
    assert found["applicable"] and found["relative"] < 1e-3


@pytest.mark.serial
def test_the_bound_includes_the_distance_to_the_solution_without_penalties() -> None:
    found = pressed_column(0.05, 1e3)
    k = 1.3461538461538463
    excess = (0.05 - k * 0.02) / (k + 2e3)
    assert found["energy_norm"] >= math.sqrt(k * 2.0) * excess


def test_the_bound_is_the_same_on_every_number_of_ranks() -> None:
    # Computed on one rank.
    assert bound(benchmark(6))["energy_norm"] == pytest.approx(0.0198434297, rel=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"contact__gap": "0.001*x*x"}, "the gap is not met between the nodes"),
        (
            {
                "contact": {
                    "on": "bottom",
                    "foundation": {"cylinder": {"centre": [0.5, -2.0], "radius": 2.0}},
                }
            },
            "the contact normal changes along a facet",
        ),
        (
            {"loads__displacements": [{"on": "left", "value": ["0.001*y*y", 0.0]}]},
            "prescribed displacements are not met between the nodes",
        ),
        (
            {"material": {"locking": [{"norm": "volume", "at_least": -0.01}]}},
            "other sets of strains than the ball",
        ),
        ({"mesh__dim": 3}, "not in three dimensions"),
        ({"mesh__axisymmetric": True}, "not for axisymmetric bodies"),
        (
            {"loads__displacements": [{"on": "left", "value": [0.0, None]}]},
            "displacement conditions alone do not hold the body",
        ),
    ],
)
def test_where_no_bound_is_proved_the_reason_is_said(changes: dict[str, Any], why: str) -> None:
    dim = changes.pop("mesh__dim", 2)
    given = block(dim, 0.25 if dim == 2 else 0.5, certificate__error_bound=True, **changes)
    found = bound(given)
    assert found["energy_norm"] is None and found["applicable"] is False
    assert found["reason"].startswith("not applicable: ") and why in found["reason"]


@pytest.mark.serial
def test_no_bound_is_proved_where_friction_counts_the_slip_from_an_earlier_step() -> None:
    pull = {"tractions": [{"on": "top", "value": ["0.03*t", "-0.05*t"]}]}
    held = {"displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    process = {"loads": pull | held, "steps": {"to": 1.0, "count": 2}}
    given = benchmark(4, **process)
    first, second = (
        solution.summary["certificate"]["errors"]["guaranteed"] for solution in solve_steps(given)
    )
    # The first step starts from rest, as a static load does.
    assert first["applicable"] is True
    assert second["applicable"] is False and second["energy_norm"] is None
    assert second["reason"] == ("not applicable: friction counts the slip from an earlier step")


@pytest.mark.parametrize("changes", [{}, {"discretisation": QUADRATIC}])
def test_the_stress_does_the_work_of_loads_and_contact_along_every_displacement(
    changes: dict[str, Any],
) -> None:
    # The top is loaded, the right side is clamped; rollers hold the left side along y alone.
    support = [{"on": "right", "value": [0.0, 0.0]}, {"on": "left", "value": [None, 0.0]}]
    pull = [{"on": "top", "value": [-0.03, -0.05]}]
    loads = {"displacements": support, "tractions": pull, "body_force": [0.01, -0.02]}
    changes = {"material__locking_limit": 0.02, "loads": loads} | changes
    solver = SolvableStudy(assemble(benchmark(4, **changes), MPI.COMM_WORLD)).solver
    state = solver.state(solver.solve())
    problem = state.problem
    triangles = Triangles(problem.domain)
    element = macro_element(problem.element.degree)
    balanced = balanced_loads(problem.data, triangles, element)
    contacts = [contact_tractions(fields, triangles) for fields in state.contacts]
    body, held = Body(state, triangles, element), held_components(state, triangles)
    forces = balanced_forces(triangles, held, balanced, contacts)
    stress = body.balanced(forces, problem.u)

    v = fem.Function(problem.u.function_space)
    v.interpolate(lambda x: np.stack([np.sin(3.0 * x[0] + x[1]), np.cos(x[0] - 2.0 * x[1])]))
    v.x.array[problem.constraints.dofs] = 0.0
    strains = body.strains(v)
    inner = np.sum(stress * (element.mass @ strains), axis=(1, 2, 3))
    work = state.sum(inner * triangles.areas / 3.0)
    for contact in contacts:
        normal, tangent = contact.split(v.x.array.reshape(-1, 2))
        pushed = product_integral(contact.along, tangent) - product_integral(
            contact.pressure, normal
        )
        work -= state.sum(contact.lengths * pushed)
    owned = 2 * v.function_space.dofmap.index_map.size_local
    outer = state.sum(state.system.forms.loads()[:owned] * v.x.array[:owned])
    assert work == pytest.approx(outer, rel=1e-8, abs=1e-10)
