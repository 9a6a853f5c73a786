"""V23, V26, V37, V42: a plate and a triangle that slide, a sphere that slips in part or turns."""

from __future__ import annotations

import math
from typing import Any

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from problems import with_changes
from verification_table import Rows

import contact_locking as cl
from contact_locking import FrictionLaw, assemble, solve
from contact_locking.arrays import FloatArray
from contact_locking.results.contact_points import SLIP
from contact_locking.results.output import Extras
from contact_locking.running.solving import SolvableStudy

pytestmark = pytest.mark.serial

#: Distances from the left corner in m, and the slips there in m (code_aster, test SSNV128).
SLIPS = {0.0: 2.86e-5, 1.25e-3: 2.72e-5, 5.0e-3: 2.28e-5, 7.5e-3: 1.98e-5}


@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_v23_the_slip_of_a_plate(degree: int, found: Rows) -> None:
    """A plate between a pressure, a wall and a floor with mu = 1, in one step, in SI units."""
    plate: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [0.04, 0.04], "h": 1.25e-3, "structured": True},
        "discretisation": {"degree": degree},
        "material": {
            "elasticity": {"young": 1.3e11, "poisson": 0.2},
            "locking_limit": math.inf,
        },
        "loads": {
            "pressures": [{"on": "top", "value": 5e7}, {"on": "left", "value": 1.5e8}],
            "supports": [{"on": "right", "along": "normal"}],
        },
        "contact": {"on": "bottom"},
        "friction": {"coefficient": 1.0, "smoothing": {"kernel": "none"}},
    }
    solution = solve(with_changes(plate))
    assert solution.converged
    (contact,) = solution.contacts
    x = contact.surface.points[:, 0]
    slip = np.linalg.norm(contact.u_tangent, axis=1)
    for place, exact in SLIPS.items():
        computed = float(slip[np.argmin(np.abs(x - place))])
        what = f"slip at x = {1e3 * place:g} mm"
        # The reference has three digits.
        found.add("V23", f"SSNV128, P{degree}", what, computed, exact, rel=4e-3)


@pytest.mark.slow
def test_v26_partial_slip_of_a_sphere(found: Rows) -> None:
    """The stick zone has the radius ``c = a (1 - Q/(mu P))^(1/3)`` (Johnson, 7.2 (b)).

    Half of a block, with its mirror image in y = 0, is pressed onto a sphere without friction, and
    then moved along.  P, Q and the radius a are those of the solution, as the block is no
    half-space.

    Hertz's pressure ``p0 sqrt(1 - r^2/a^2)`` has the second moment ``int p r^2 = 2/5 a^2 int p``,
    and what the friction traction leaves of its bound is a pressure of Hertz with the radius c.
    Radii by these moments do not depend on how many nodes stick, as radii by areas do.
    """
    mu, depth, shift, sphere = 0.5, 0.045, 0.03, 2.0
    young, poisson = 1.0, 0.45
    data: dict[str, Any] = {
        "mesh": {
            "builder": "block",
            "dim": 3,
            "size": [2.0, 1.0, 1.0],
            "h": 0.4,
            "h_contact": 0.08,
        },
        "discretisation": {"degree": 2},
        "material": {
            "elasticity": {"young": young, "poisson": poisson},
            "locking_limit": math.inf,
        },
        "loads": {
            "displacements": [
                {"on": "top", "value": [f"{shift}*max(t - 1, 0)", 0, f"-{depth}*min(t, 1)"]},
                {"on": "front", "value": [None, 0, None]},
            ]
        },
        "contact": {"on": "bottom", "gap": f"((x - 1)**2 + y**2)/{2.0 * sphere}"},
        "friction": {"coefficient": mu, "smoothing": {"kernel": "none"}},
        "steps": {"times": [1.0, 1.5, 2.0]},
    }
    problem = assemble(with_changes(data), MPI.COMM_WORLD)
    steps = SolvableStudy(problem).solutions()
    (friction,) = (contact.friction for contact in problem.contacts)
    law, friction.law = friction.law, FrictionLaw(lambda x, s: 0.0 * s, 0.0, 0.0)
    pressed = next(steps)
    friction.law = law
    (contact,) = pressed.contacts
    weights, r2 = contact.surface.weights, np.sum((contact.surface.points - [1, 0, 0]) ** 2, axis=1)

    def radius(traction: FloatArray) -> float:
        return math.sqrt(2.5 * float(np.sum(weights * traction * r2) / np.sum(weights * traction)))

    force = pressed.summary["contact_force"][2]
    # The force of the whole body is twice that of its half.
    hertz = (3.0 * 2.0 * force * sphere * (1.0 - poisson**2) / (4.0 * young)) ** (1.0 / 3.0)
    a, by_area = radius(contact.pressure), math.sqrt(2.0 * pressed.summary["contact_area"] / np.pi)
    found.add("V26", "Hertz, 3D, P2", "radius a by moments", a, hertz, rel=0.01)
    for solution in steps:
        assert solution.converged, solution.summary["reason"]
        force = solution.summary["contact_force"][2]
        share = abs(solution.summary["friction_force"][0]) / (mu * force)
        assert 0.15 < share < 0.97
        exact = (1.0 - share) ** (1.0 / 3.0)
        (contact,) = solution.contacts
        c = radius(contact.bound - np.linalg.norm(contact.traction, axis=1))
        sticks = solution.summary["contact_area"] - solution.summary["slip_area"]
        stick = math.sqrt(2.0 * sticks / math.pi)
        case = f"Cattaneo-Mindlin, 3D, P2, Q = {share:.2f} mu P"
        found.add("V26", case, "c/a by moments", c / a, exact, rel=0.02)
        # Some ten nodes are along the radius.
        found.add("V26", case, "c/a by areas", stick / by_area, exact, rel=0.04)


@pytest.mark.slow
def test_v37_the_torque_that_turns_a_sphere_on_a_block(found: Rows) -> None:
    """Where all slips, Hertz's pressure over a circle of radius a resists ``3 pi/16 mu N a``.

    N and a, by the second moment of the pressure, are those of the solution, as the block is no
    half-space.
    """
    mu, sphere = 0.3, 2.0
    data: dict[str, Any] = {
        "mesh": {
            "builder": "block", "dim": 3, "size": [2.0, 2.0, 1.0], "h": 0.5, "h_contact": 0.12,
        },
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": math.inf},
        "loads": {"displacements": [{"on": "top", "value": [0, 0, 0]}]},
        "contact": {
            "on": "bottom",
            "foundation": {
                "sphere": {"centre": [1.0, 1.0, -sphere], "radius": sphere},
                "motion": {
                    "translation": [0, 0, "0.045*min(t, 1)"],
                    "rotation": [0, 0, "0.3*max(t - 1, 0)"],
                    "about": [1.0, 1.0, -sphere],
                },
            },
        },
        "friction": {"coefficient": mu, "smoothing": {"kernel": "none"}},
        "steps": {"times": [1.0, 2.0]},
    }  # fmt: skip
    pressed, turned = SolvableStudy(assemble(with_changes(data), MPI.COMM_WORLD)).solutions()
    assert pressed.converged and turned.converged
    assert abs(pressed.summary["contact_moment"][2]) < 1e-5
    assert turned.summary["friction_used"] == pytest.approx(1.0)
    (contact,) = turned.contacts
    forces = contact.surface.weights * contact.pressure
    r2 = np.sum((contact.surface.points - [1, 1, 0]) ** 2, axis=1)
    force = turned.summary["contact_force"][2]
    a = math.sqrt(2.5 * float(np.sum(forces * r2)) / float(np.sum(forces)))
    torque, exact = turned.summary["contact_moment"][2], 3.0 * math.pi / 16.0 * mu * force * a
    found.add("V37", "a sphere that turns, 3D", "torque", torque, exact, rel=0.01)


@pytest.mark.parametrize("poisson", [0.1, 0.3])
@pytest.mark.parametrize("parts", [1, 6])
def test_v42_the_critical_friction_of_a_triangle(poisson: float, parts: int, found: Rows) -> None:
    """``mu = sqrt((1 - nu)/nu)``, in plane strain and with the pressure of the place itself.

    ``v = (l, 0)``, for the linear ``l = 1 - x - r y`` that is zero on the side that is held, has
    the stresses ``-(lambda + 2G, lambda)`` along the axes and the shear ``-G r``.  The shear on the
    floor is ``G r/lambda`` times the pressure, and the left side is free of traction if it has the
    direction ``(r, k)`` with ``k = lambda/G`` and ``r^2 = k (k + 2)``.  So a triangle that slides
    to the left with this coefficient may slide on by any multiple of v.  P1 has v on each mesh.
    """
    ratio = 2.0 * poisson / (1.0 - 2.0 * poisson)
    slope = math.sqrt(ratio * (ratio + 2.0))
    shear, mu, depth = 0.5 / (1.0 + poisson), 0.5, 0.01
    top = np.array([1.0, ratio / slope]) / (1.0 + ratio)
    pressure = (ratio + 2.0) * shear * depth
    body = _triangle(top, parts)
    space = fem.functionspace(body, ("Lagrange", 1, (2,)))
    held = fem.Function(space)
    held.interpolate(lambda x: np.array([-0.02 - mu * pressure / shear * x[1], -depth * x[1]]))
    on_right = fem.locate_dofs_geometrical(
        space, lambda x: np.isclose(1.0 - x[0] - slope * x[1], 0.0)
    )
    left, floor = (
        mesh.locate_entities_boundary(
            body, 1, lambda x, n=n: np.isclose(n[0] * x[0] + n[1] * x[1], 0.0)
        )
        for n in ((top[1], -top[0]), (0.0, 1.0))
    )
    tags = mesh.meshtags(body, 1, np.sort(left), np.ones(len(left), dtype=np.int32))
    ds = ufl.Measure("ds", body, subdomain_data=tags)
    stress = ufl.as_matrix([[-ratio * shear * depth, -mu * pressure], [-mu * pressure, -pressure]])
    traction = stress * ufl.FacetNormal(body)
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=poisson),
        ufl.inner(traction, ufl.TestFunction(space)) * ds(1),
        [fem.dirichletbc(held, on_right)],
        contacts=[
            cl.Contact(floor, cl.HalfSpace((0.0, 0.0), (0.0, 1.0)), cl.Coulomb(mu, cl.Local()))
        ],
        n=math.inf,
    )
    solution = problem.solve(extras=Extras(critical_friction=True))
    problem.close()
    assert solution.converged
    (contact,) = solution.contacts
    assert np.sum(contact.state == SLIP) == parts
    computed = solution.summary["certificate"]["critical_friction"]["coefficient"]
    exact = math.sqrt((1.0 - poisson) / poisson)
    what = f"triangle that slides, h = {1.0 / parts:.3g}, nu = {poisson}"
    found.add("V42", what, "critical friction", computed, exact, rel=1e-6)


def _triangle(top: FloatArray, parts: int) -> mesh.Mesh:
    """A triangle on the unit interval, each side in equal parts."""
    numbers = {
        place: number
        for number, place in enumerate(
            (i, j) for j in range(parts + 1) for i in range(parts + 1 - j)
        )
    }
    points = np.array([np.array([i, 0.0]) + j * top for i, j in numbers]) / parts
    corners = [((i, j), (i + 1, j), (i, j + 1)) for i, j in numbers if i + j < parts] + [
        ((i + 1, j), (i + 1, j + 1), (i, j + 1)) for i, j in numbers if i + j < parts - 1
    ]
    cells = np.array([[numbers[place] for place in corner] for corner in corners])
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    return mesh.create_mesh(comm=MPI.COMM_SELF, cells=cells, x=points, e=element)
