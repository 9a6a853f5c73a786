"""V10: an annulus whose inner ring locks, between circles with prescribed radial displacements.

In the locked ring ``u = r M sin(phi)``, ``u' = -M cos(phi)``, so ``|eps| = M`` and compatibility
gives ``r = C exp(-phi/2) (sin(phi) + cos(phi))^(-1/2)``; outside ``u = A r + B/r``.  Both match at
the edge ``r = c`` of the ring in displacement and strain.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import dolfinx
import numpy as np
import pytest
import ufl
from dolfinx import fem
from manufactured import rate
from problems import solved, with_changes
from scipy.integrate import solve_ivp
from slow import slow
from verification_table import Rows

from contact_locking.arrays import FloatArray
from contact_locking.laws.body import lame_from_young
from contact_locking.results.solution import StudySolution

INNER, OUTER, EDGE, LIMIT = 1.0, 2.0, 1.4, 0.02
ANGLE = 0.5  # phi at the edge
LAME_LAMBDA, LAME_MU = lame_from_young(1.0, 0.3)
SIZES = [0.2, 0.1, 0.05, 0.025]


def _shape(phi: Any) -> FloatArray:
    return np.asarray(np.exp(-0.5 * phi) / np.sqrt(np.sin(phi) + np.cos(phi)))


_ANGLES = np.linspace(ANGLE, 1.5, 100_001)
_RADII = EDGE * _shape(_ANGLES) / _shape(ANGLE)


def angle(r: FloatArray | float) -> FloatArray:
    """phi in the ring; it falls with r."""
    return np.asarray(np.interp(-np.asarray(r), -_RADII, _ANGLES))


def radial(r: FloatArray | float) -> FloatArray:
    """The exact radial displacement."""
    a = 0.5 * LIMIT * (math.sin(ANGLE) - math.cos(ANGLE))
    b = 0.5 * LIMIT * EDGE**2 * (math.sin(ANGLE) + math.cos(ANGLE))
    ring = r * LIMIT * np.sin(angle(np.minimum(r, EDGE)))
    return np.where(np.asarray(r) < EDGE, ring, a * r + b / r)


def locking_stress() -> tuple[FloatArray, FloatArray]:
    """Radii and ``|Z|`` in the ring, from equilibrium inwards with ``Z = 0`` at the edge."""

    def slope(r: float, z: FloatArray) -> FloatArray:
        phi = angle(r)
        sine, cosine = np.sin(phi), np.cos(phi)
        turn = -(sine + cosine) / (r * cosine)
        elastic = (LAME_LAMBDA + 2.0 * LAME_MU) * LIMIT
        force = elastic * (sine * turn - (cosine + sine) / r)
        return np.asarray((force - z * ((cosine + sine) / r - sine * turn)) / cosine)

    solved = solve_ivp(slope, [EDGE, INNER], [0.0], rtol=1e-8, dense_output=True)
    return solved.t, solved.y[0]


def annulus(h: float, n: float, **changes: Any) -> StudySolution:
    circles = {name: float(radial(r)) / r for name, r in (("inner", INNER), ("outer", OUTER))}
    held: list[dict[str, Any]] = [
        {"on": name, "value": [f"{u!r}*x", f"{u!r}*y"]} for name, u in circles.items()
    ]
    held += [{"on": "left", "value": [0, None]}, {"on": "bottom", "value": [None, 0]}]
    parameters = with_changes(
        {
            "mesh": {
                "builder": "annulus",
                "quarter": True,
                "inner_radius": INNER,
                "outer_radius": OUTER,
                "h": h,
            },
            "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": LIMIT},
            "loads": {"displacements": held},
            "contact": {"on": []},
            "penalty": {"n": n},
        },
        **changes,
    )
    solution = solved(parameters)
    return solution


def exact_displacement(mesh: dolfinx.mesh.Mesh) -> fem.Function:
    """The exact solution as a cubic field; collective."""
    exact = fem.Function(fem.functionspace(mesh, ("P", 3, (2,))))

    def value(x: FloatArray) -> FloatArray:
        r = np.hypot(x[0], x[1])
        return np.asarray(radial(r) / r * x[:2])

    exact.interpolate(value)
    return exact


def errors(solution: StudySolution) -> tuple[float, float]:
    """The relative errors in V and in L2."""
    mesh = solution.domain.mesh
    exact = exact_displacement(mesh)
    error = solution.displacement - exact

    def norm(tensor: Callable[[ufl.core.expr.Expr], ufl.core.expr.Expr]) -> float:
        parts = [
            fem.assemble_scalar(fem.form(ufl.inner(tensor(v), tensor(v)) * ufl.dx))
            for v in (error, exact)
        ]
        top, bottom = solution.domain.comm.allreduce(np.array(parts))
        return float(np.sqrt(top / bottom))

    return norm(lambda v: ufl.sym(ufl.grad(v))), norm(lambda v: v)


def test_v10_the_locking_stress_of_the_exact_solution_pulls_inwards_everywhere() -> None:
    radii, stress = locking_stress()
    assert radii[0] == EDGE and radii[-1] == INNER
    assert np.all(stress[1:] > 0.0)
    assert 0.0 < angle(INNER) < 0.5 * math.pi


@pytest.mark.parametrize("n", [slow(1e6), math.inf])
def test_v10_the_annulus_converges_to_its_exact_solution(n: float, found: Rows) -> None:
    in_v, in_l2 = zip(*(errors(annulus(h, n)) for h in SIZES), strict=True)
    where = f"annulus, n = {n:g}"
    found.add("V10", where, "rate in V", rate(SIZES, in_v), 1.0, abs=0.1)
    found.add("V10", where, "relative V error, h = 1/40", in_v[-1], None, abs=0.022)
    found.add("V10", where, "relative L2 error, h = 1/40", in_l2[-1], None)
    # In the locked ring P1 elements must follow |eps| <= M cell by cell: L2 gains no order.
    assert rate(SIZES, in_l2) > 0.95


def test_v10_the_locking_stress_and_the_edge_of_the_ring_are_found(found: Rows) -> None:
    radii, stress = locking_stress()
    solution = annulus(SIZES[-1], math.inf)
    domain = solution.domain
    owned = domain.mesh.topology.index_map(2).size_local
    size = np.linalg.norm(solution.locking_stress.x.array.reshape(-1, 4)[:owned], axis=1)
    dofs = solution.locked.function_space.dofmap.list.reshape(-1)[:owned]
    cells = fem.assemble_vector(
        fem.form(ufl.TestFunction(solution.locked.function_space) * ufl.dx)
    ).array[dofs]
    total = domain.comm.allreduce(float(cells @ size))
    exact = 0.5 * math.pi * abs(float(np.trapezoid(stress * radii, radii)))
    found.add(
        "V10", "annulus, n = inf, h = 1/40", "integral of the norm of Z", total, exact, rel=0.1
    )
    points = fem.Function(fem.functionspace(domain.mesh, ("DG", 0)))
    points.interpolate(lambda x: np.hypot(x[0], x[1]))
    farthest = points.x.array[solution.locked.x.array > 0.5].max(initial=0.0)
    edge = max(domain.comm.allgather(float(farthest)))
    found.add(
        "V10", "annulus, n = inf, h = 1/40", "edge of the ring", edge, EDGE, abs=4.0 * SIZES[-1]
    )
