"""V38 to V40, V45 to V50: rings, discs, blocks and balls that touch, a crack, a column."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import Mesh
from mpi4py import MPI
from problems import solved, with_changes
from small_meshes import Groups, Points, grid, shared
from two_bodies import POISSON, YOUNG, fit, lame_pressure, stack, two_discs
from verification_table import Rows

import contact_locking as cl
from contact_locking import assemble, solve_steps
from contact_locking.laws.body import lame_from_young
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

pytest.importorskip("gmsh")


def test_v45_partial_slip_between_equal_discs(found: Rows) -> None:
    """The stick zone has half-width ``c = a sqrt(1 - Q/(mu P))``, as on a plane (Johnson, 7.2).

    Equal discs do not slip as they are pressed, and so friction acts from the beginning.
    """
    mu, fine = 0.5, 0.0125
    mesh, facets = two_discs((1.0, 1.0), 0.25, fine, quarter=False)
    space = fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    shift = np.zeros(1)
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3),
        None,
        [
            *(cl.Support(facets["bottom"], axis, 0.0) for axis in ((1.0, 0.0), (0.0, 1.0))),
            cl.Support(facets["top"], (1.0, 0.0), lambda x: np.full(x.shape[1], shift[0])),
            cl.Support(facets["top"], (0.0, 1.0), -0.04),
        ],
        [],
        [
            cl.Contact(
                facets["upper"],
                against=facets["lower"],
                friction=cl.Coulomb(mu, cl.Local(), regularisation=0.0),
            )
        ],
        space=space,
    )
    solution = problem.solve()
    assert solution.converged, solution.summary["reason"]
    a = 0.5 * solution.summary["contact_area"]
    for value in (0.012, 0.024):
        shift[0] = value
        solution = problem.solve(after=solution)
        assert solution.converged, solution.summary["reason"]
        force = solution.summary["contact_force"][1]
        share = abs(solution.summary["friction_force"][0]) / (mu * force)
        stick = 0.5 * (solution.summary["contact_area"] - solution.summary["slip_area"])
        c = a * math.sqrt(1.0 - share)
        told = f"Cattaneo-Mindlin, equal discs, Q = {share:.2f} mu P"
        found.add("V45", told, "stick half-width over a", stick / a, c / a)
        assert 0.15 < share < 0.9
        assert stick == pytest.approx(c, abs=fine)
    problem.close()


def cracked(comm: MPI.Intracomm, folder: Path, half: float, far: float, fine: float) -> Path:
    """A square of half-width ``far`` with a cut ``|x| < half`` in y = 0, whose tips are shared."""
    inner = np.linspace(-half, half, 2 * round(half / fine) + 1)
    steps = np.cumsum(fine * 1.18 ** np.arange(1, 100))
    outer = steps[half + steps < 0.9 * far]
    outer = np.append(outer, far - half)
    xs = np.concatenate([-half - outer[::-1], inner, half + outer])
    above = np.append(steps[steps < 0.9 * far], far)
    ys = np.concatenate([-above[::-1], [0.0], above])
    points: Points = [(float(x), float(y)) for y in ys for x in xs]
    n, middle = len(xs), len(above)
    row = [middle * n + i + 1 for i in range(n)]
    lip = [node for node, x in zip(row, xs, strict=True) if abs(x) < half - 0.5 * fine]
    twins = {node: len(points) + k + 1 for k, node in enumerate(lip)}
    points += [points[node - 1] for node in lip]
    cells: list[tuple[int, ...]] = []
    for j in range(len(ys) - 1):
        for i in range(n - 1):
            corner = j * n + i + 1
            square = (corner, corner + 1, corner + n + 1, corner + n)
            a, b, c, d = (twins.get(k, k) for k in square) if j >= middle else square
            # The diagonals are mirrored at the axes.
            turned = (j >= middle) == (xs[i] >= -1e-12)
            cells += [(a, b, c), (a, c, d)] if turned else [(a, b, d), (b, c, d)]
    ends = [row[np.searchsorted(xs, x - 0.5 * fine)] for x in (-half, half)]
    lower = [*zip((ends[0], *lip), (*lip, ends[1]), strict=True)]
    upper = [tuple(twins.get(k, k) for k in facet) for facet in lower]
    last = len(ys) - 1
    rim = [(i + 1, i + 2) for i in range(n - 1)]
    rim += [(last * n + i + 1, last * n + i + 2) for i in range(n - 1)]
    rim += [(j * n + 1, (j + 1) * n + 1) for j in range(last)]
    rim += [((j + 1) * n, (j + 2) * n) for j in range(last)]
    groups: Groups = {"rim": rim, "lower": lower, "upper": upper, "body": cells}
    return shared(comm, folder, points, groups)


def test_v46_a_closed_crack_slips_as_far_as_friction_lets_it(tmp_path: Path, found: Rows) -> None:
    """A crack in an infinite body under the pressure p and the shear tau, with a varying mu.

    With ``mu = m + k x^2`` the shear that drives slip is ``K (c^2/2 - x^2)``, ``K = k p`` and
    ``c^2 = 2 (tau - m p)/K``, where no stress is singular at the ends of the slip zone |x| < c.
    The slip is ``w = (4 (1 - nu^2)/E) (K/3) (c^2 - x^2)^(3/2)``: the operator from slips to
    stresses maps ``sin((n + 1) theta)`` to ``(n + 1) U_n`` (Bilby and Eshelby).
    Friction dissipates ``int mu p w``, as the bound does not depend on the slip.
    """
    p, m, k, c, fine, far = 1e-3, 0.2, 0.3, 0.8, 0.04, 12.0
    tau = p * (m + 0.5 * k * c**2)
    path = cracked(MPI.COMM_WORLD, tmp_path, 1.2, far, fine)
    # The displacement of the body without a crack, in plane strain.
    shear = YOUNG / (2.0 * (1.0 + POISSON))
    down = -p * (1.0 - POISSON**2) / YOUNG
    aside = p * POISSON * (1.0 + POISSON) / YOUNG
    data: dict[str, Any] = {
        "mesh": {"file": str(path)},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {
            "displacements": [{"on": "rim", "value": [f"{aside}*x + {tau / shear}*y", f"{down}*y"]}]
        },
        "contact": {"on": "upper", "against": "lower"},
        "friction": {
            "coefficient": f"{m} + {k}*x**2",
            "smoothing": {"kernel": "none"},
            "regularisation": 0.0,
        },
        "penalty": {"n": math.inf},
        "steps": {"to": 1.0, "count": 1},
    }
    solution = solved(with_changes(data))
    factor = 4.0 * (1.0 - POISSON**2) / YOUNG * k * p / 3.0
    slip, zone = factor * c**3, 2.0 * c
    lost = p * factor * math.pi * (0.375 * m * c**4 + k * c**6 / 16.0)
    summary = solution.summary
    spent = summary["steps"]["dissipated"]
    told = "a closed crack under pressure and shear"
    found.add("V46", told, "slip zone", summary["slip_area"], zone, abs=2.0 * fine)
    found.add("V46", told, "largest slip", summary["slip_max"], slip, rel=0.03)
    found.add("V46", told, "dissipated energy", spent, lost, rel=0.03)


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_v47_a_column_of_locking_blocks_is_shortened_layer_by_layer(
    n: float, tmp_path: Path, found: Rows
) -> None:
    """Three layers in uniaxial strain, of which the pressure locks the softest one."""
    pressure, divisions = 0.02, (3, 5, 4)
    moduli, limits = (1.0, 2.0, 0.5), (0.05, 0.05, 0.01)
    points: Points = []
    groups: Groups = {"sides": [], "bottom": [], "top": []}
    for number, count in enumerate(divisions):
        first = len(points) + 1
        own, cells = grid(0.0, float(number), first, count)
        points += own
        row = [(first + i, first + i + 1) for i in range(count)]
        groups |= {f"layer{number}": cells, f"low{number}": row}
        groups[f"high{number}"] = [
            (a + count * (count + 1), b + count * (count + 1)) for a, b in row
        ]
        edge = [(first + j * (count + 1), first + (j + 1) * (count + 1)) for j in range(count)]
        groups["sides"] = [*groups["sides"], *edge, *((a + count, b + count) for a, b in edge)]
    groups["bottom"], groups["top"] = groups.pop("low0"), groups.pop("high2")
    data: dict[str, Any] = {
        "mesh": {"file": str(shared(MPI.COMM_WORLD, tmp_path, points, groups))},
        "material": {
            "regions": {
                f"layer{i}": {
                    "elasticity": {"young": moduli[i], "poisson": POISSON},
                    "locking_limit": limits[i],
                }
                for i in range(3)
            }
        },
        "loads": {
            "displacements": [
                {"on": "sides", "value": [0.0, None]},
                {"on": "bottom", "value": [None, 0.0]},
            ],
            "tractions": [{"on": "top", "value": [0.0, -pressure]}],
        },
        "contact": [{"on": f"low{i + 1}", "against": f"high{i}"} for i in range(2)],
        "penalty": {"n": n},
    }
    solution = solved(with_changes(data))
    exact = 0.0
    for young, limit in zip(moduli, limits, strict=True):
        first_lame, shear = lame_from_young(young, POISSON)
        stiffness = first_lame + 2.0 * shear
        strain = pressure / stiffness
        if strain > limit:
            strain = limit + (pressure - stiffness * limit) / (stiffness + 2.0 * n)
        exact += strain
    # Of a finite n the compliance of the contacts is 1/n.
    exact += 0.0 if n == math.inf else 2.0 * pressure * solution.summary["penalty"]["epsilon"]
    sunk = solution.summary["compliance"] / pressure
    told = f"a column of three locking layers, n = {n:g}"
    found.add("V47", told, "shortening", sunk, exact, rel=1e-7)
    assert solution.summary["pressure_max"] == pytest.approx(pressure, rel=1e-7)


def pushed(count: int) -> Parameters:
    """A block that is pressed on another, pushed there and back in steps."""
    loads = {
        "displacements": [
            {"on": "bottom", "value": [0.0, 0.0]},
            {"on": "top", "value": ["0.03*sin(pi*t)", "-0.005*min(4*t, 1)"]},
        ]
    }
    steps = {"to": 1.5, "count": count}
    return stack(2, 0.25, friction__coefficient=0.3, loads=loads, steps=steps)


def test_v48_work_on_two_bodies_is_stored_or_dissipated(found: Rows) -> None:
    lost = []
    for count in (12, 48):
        *_, last = solve_steps(pushed(count))
        assert last.converged, last.summary["reason"]
        steps, rows = last.summary["steps"], last.history.rows
        assert max(row["energy_defect"] for row in rows) < 1e-6
        spent = steps["work"] - rows[-1]["stored"]
        assert spent == pytest.approx(steps["dissipated"] + steps["numerical"], rel=1e-9)
        lost.append(steps["numerical"] / steps["work"])
    told = "two blocks, pushed there and back"
    rate = math.log(lost[0] / lost[1]) / math.log(4.0)
    found.add("V48", told, "rate of the numerical loss in the step", rate, 1.0, abs=0.2)
    found.add("V48", told, "numerical loss over work, 48 steps", lost[1], None)
    assert lost[1] > 0.0


@pytest.mark.parametrize(
    ("degree", "dim", "cells"),
    [(1, 2, "simplex"), (1, 3, "simplex"), (1, 3, "box"), (2, 2, "simplex"), (2, 3, "simplex")],
)
def test_v49_forces_and_moments_of_both_sides_cancel(
    dim: int, cells: str, degree: int, found: Rows
) -> None:
    """On a flat, tilted interface, of which side 2 covers a part of the facets at the rim."""
    problem = assemble(
        stack(
            dim,
            0.25 if dim == 2 else 0.4,
            mesh__slope=0.2,
            mesh__upper=[1.3] * dim,
            mesh__cells=cells,
            mesh__structured=cells == "box",
            friction__coefficient=0.3,
            discretisation__degree=degree,
        ),
        MPI.COMM_WORLD,
    )
    (contact,) = problem.contacts
    surface = contact.surface
    # Any tractions at the nodes of side 1.
    tractions = np.sin(surface.points @ np.arange(1.0, dim * dim + 1.0).reshape(dim, dim))
    tractions[contact.surface.weights == 0.0] = 0.0
    space = problem.u.function_space
    owned = space.dofmap.index_map.size_local
    forces = surface.nodal_forces(tractions).reshape(-1, dim)[:owned]
    x = space.tabulate_dof_coordinates()[:owned, :dim]
    # x_i f_j - x_j f_i
    products = np.einsum("ki,kj->ij", x, forces)
    comm = problem.domain.comm
    moment = np.abs(comm.allreduce(products - products.T)).max()
    force = np.abs(comm.allreduce(forces.sum(axis=0))).max()
    size = comm.allreduce(np.abs(forces).sum())
    of_boxes = ", hexahedra" if cells == "box" else ""
    told = f"both sides of a tilted interface, {dim}D{of_boxes}, degree {degree}"
    found.add("V49", told, "sum of the forces", force / size, None)
    found.add("V49", told, "sum of the moments", moment / size, None)
    assert force <= 1e-13 * size and moment <= 1e-13 * size


def above_and_below(mesh: Mesh, above: float, below: float) -> fem.Function:
    """A function with one value in the cells above y = 0 and another one below."""
    found = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    found.interpolate(lambda x: np.where(x[1] > 0.0, above, below))
    return found


@pytest.mark.parametrize("swapped", [False, True])
def test_v38_press_fitted_rings_have_the_pressure_of_lame(swapped: bool, found: Rows) -> None:
    sides = ("rim", "inner") if swapped else ("inner", "rim")
    contact = {"on": sides[0], "against": sides[1], "gap": -0.01}
    errors = []
    for h in (0.16, 0.08):
        solution = solved(fit(contact=contact, mesh__h=h))
        points, area = solution.contact_points, solution.summary["contact_area"]
        assert area == pytest.approx(math.pi / 2, rel=0.01)
        if points is not None:
            mean = float(points.pressure.mean())
            problem = f"press-fitted rings, {sides[0]} with the conditions, h = {h:g}"
            found.add("V38", problem, "mean pressure", mean, lame_pressure(0.01))
            errors.append(np.abs(points.pressure / lame_pressure(0.01) - 1.0).max())
    if errors:
        assert errors[1] <= 0.6 * errors[0] and errors[1] <= 0.03


@pytest.mark.parametrize(("n", "boxes"), [(math.inf, False), (1e4, False), (math.inf, True)])
def test_v39_two_discs_press_as_hertz_says(n: float, boxes: bool, found: Rows) -> None:
    """Discs in plane strain, or cylinders of height 1 in layers that do not match."""
    radii, youngs, poisson = (1.0, 2.0), (1.0, 3.0), 0.3
    mesh, facets = two_discs(radii, 0.25, 0.02, layers=(1.0, 0.5) if boxes else None)
    space = fem.functionspace(mesh, ("Lagrange", 1, (mesh.geometry.dim,)))
    along, up = np.eye(mesh.geometry.dim)[:2]
    problem = cl.ContactProblem(
        cl.Elasticity(young=above_and_below(mesh, *youngs), poisson=poisson),
        None,
        [
            cl.Support(facets["axis"], along, 0.0),
            cl.Support(facets["bottom"], up, 0.0),
            cl.Support(facets["top"], up, -0.02),
            *[cl.Support(facets["ends"], (0.0, 0.0, 1.0), 0.0)][: int(boxes)],
        ],
        [],
        [cl.Contact(facets["upper"], against=facets["lower"])],
        space=space,
        n=n,
    )
    solution = problem.solve()
    assert solution.converged, solution.summary["reason"]
    force = 2.0 * solution.summary["contact_force"][1]
    stiffness = 1.0 / sum((1.0 - poisson**2) / modulus for modulus in youngs)
    radius = 1.0 / sum(1.0 / r for r in radii)
    half = math.sqrt(4.0 * force * radius / (math.pi * stiffness))
    peak = 2.0 * force / (math.pi * half)
    assert solution.summary["pressure_max"] == pytest.approx(peak, rel=0.03)
    pressure = solution.summary["pressure_max"]
    told = f"two elastic {'cylinders of hexahedra' if boxes else 'discs'}, n = {n:g}"
    found.add("V39", told, "peak pressure", pressure, peak)
    # To half a facet.
    found.add("V39", told, "half-width", solution.summary["contact_area"], half, abs=0.015)
    points = solution.contact_points
    if points is not None:
        exact = peak * np.sqrt(np.maximum(1.0 - (points.x[:, 0] / half) ** 2, 0.0))
        inside = points.x[:, 0] < 0.8 * half
        assert np.abs(points.pressure - exact)[inside].max() <= 0.03 * peak
    problem.close()


def test_v40_a_block_on_a_stiff_block_is_one_on_a_rigid_foundation(found: Rows) -> None:
    held = [{"on": ["upper_left", "upper_right"], "value": [0.0, None]}]
    held.append({"on": "bottom", "value": [0.0, 0.0]})
    load = [{"on": "top", "value": ["0.0", "-0.02*(1 + x)"]}]
    common: dict[str, Any] = {
        "loads": {"displacements": held, "tractions": load},
    }
    rigid = solved(stack(2, 0.2, **common, contact={"on": "upper_bottom"}))
    differences, tangents = [], []
    for young in (1e2, 1e4):
        lower = {"lower": {"elasticity": {"young": young, "poisson": POISSON}}}
        one = solved(stack(2, 0.2, **common, material__regions=lower))
        assert one.summary["pressure_max"] == pytest.approx(rigid.summary["pressure_max"], rel=0.05)
        differences.append(abs(one.summary["displacement_max"] - rigid.summary["displacement_max"]))
        tangents.append(one.summary["iterations"]["tangents"])
    rate = math.log(differences[0] / differences[1]) / math.log(100.0)
    problem = "a block on a stiff block, beside a rigid foundation"
    found.add("V40", problem, "rate of the displacement in 1/E", rate, 1.0)
    # As 1/E of the stiff block.
    assert differences[1] == pytest.approx(0.01 * differences[0], rel=0.05)
    assert max(tangents) <= rigid.summary["iterations"]["tangents"] + 3


def test_v50_two_balls_press_as_hertz_says(found: Rows) -> None:
    """Balls of different stiffness and radius, as half sections about their axis."""
    radii, youngs, poisson, shift = (1.0, 2.0), (1.0, 3.0), 0.3, 0.01
    mesh, facets = two_discs(radii, 0.2, 0.01)
    space = fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    problem = cl.ContactProblem(
        cl.Elasticity(young=above_and_below(mesh, *youngs), poisson=poisson),
        None,
        [
            cl.Support(facets["bottom"], (0.0, 1.0), 0.0),
            cl.Support(facets["top"], (0.0, 1.0), -shift),
        ],
        [],
        [cl.Contact(facets["upper"], against=facets["lower"])],
        space=space,
        axisymmetric=True,
    )
    solution = problem.solve()
    assert solution.converged, solution.summary["reason"]
    force = solution.summary["contact_force"][1]
    stiffness = 1.0 / sum((1.0 - poisson**2) / modulus for modulus in youngs)
    radius = 1.0 / sum(1.0 / r for r in radii)
    half = (0.75 * force * radius / stiffness) ** (1.0 / 3.0)
    peak = 1.5 * force / (math.pi * half**2)
    found_half = math.sqrt(solution.summary["contact_area"] / math.pi)
    points = solution.contact_points
    told = "two elastic balls"
    found.add("V50", told, "radius of the contact", found_half, half, abs=0.01)
    if points is not None:
        exact = peak * np.sqrt(np.maximum(1.0 - (points.x[:, 0] / half) ** 2, 0.0))
        inside = (points.x[:, 0] > 0.1 * half) & (points.x[:, 0] < 0.9 * half)
        error = np.abs(points.pressure - exact)[inside].max() / peak
        found.add("V50", told, "error of the pressure over its peak", error, None, abs=0.03)
    # The approach of half balls, whose flat faces move, less the compression of their rests.
    approach = half**2 / radius
    found.add("V50", told, "approach of the flat faces", shift, approach)
    assert approach == pytest.approx(shift, rel=0.1)
    problem.close()
