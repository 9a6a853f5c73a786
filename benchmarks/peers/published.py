"""Problems that the authors of other programs publish, by their methods and by contact_locking.

    ./in-env python3 benchmarks/peers/published.py

writes benchmarks/peers/published.md.  A half sphere on a plane and a limit of the gradient are
examples 2 and 6 of https://github.com/METHODS-Group/ProximalGalerkin; an obstacle and a limit of
the gradient in one dimension have closed forms.  Their method is written anew with their elements,
steps and tolerances.  A scalar w is for contact_locking a displacement (w, 0) or (0, w) in the
plane, whose other component is held.  A bridge under its weight is a study of
https://github.com/KOS-UJ/conmech, examples/BOST_2024.py, with the errors that stand there, and two
blocks are the first problem of the miniapp contact of MFEM.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import ufl
from basix.ufl import element, mixed_element
from dolfinx import fem, io, mesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import brentq

import contact_locking as cl

COMM = MPI.COMM_WORLD


class Proximal:
    """Steps of the proximal point method, each by Newton's method on a mixed space.

    ``form`` is the residual of a step at ``now``, with the step length ``alpha`` and the state
    ``before``; the displacement has the dofs ``to_u``.
    """

    def __init__(self, space: fem.FunctionSpace) -> None:
        self.now, self.before = fem.Function(space), fem.Function(space)
        self.alpha = fem.Constant(space.mesh, 1.0)
        self.to_u = np.asarray(space.sub(0).collapse()[1])

    def prepare(self, form: Any, bcs: Any, rtol: float) -> None:
        """Compile the residual and its tangent."""
        self.bcs, self.rtol = bcs, rtol
        self.F, self.J = fem.form(form), fem.form(ufl.derivative(form, self.now))
        self.A, self.b = petsc.create_matrix(self.J), petsc.create_vector(self.F)
        self.ksp = PETSc.KSP().create()
        self.ksp.setOperators(self.A)
        self.ksp.setType("preonly")
        self.ksp.pc.setType("lu")
        self.ksp.pc.setFactorSolverType("mumps")
        petsc.set_bc(self.now.x.petsc_vec, bcs)

    def newton(self) -> int:
        """The tangents of a step; negative if it fails."""
        change, first = self.b.duplicate(), 0.0
        for count in range(251):
            self.b.set(0.0)
            petsc.assemble_vector(self.b, self.F)
            petsc.set_bc(self.b, self.bcs, self.now.x.petsc_vec, -1.0)
            size = self.b.norm()
            first = first or size
            if not np.isfinite(size):
                return -count
            if size <= self.rtol * max(first, 1.0) and count:
                return count
            self.A.zeroEntries()
            petsc.assemble_matrix(self.A, self.J, self.bcs)
            self.A.assemble()
            self.ksp.solve(self.b, change)
            self.now.x.petsc_vec.axpy(-1.0, change)
            self.now.x.scatter_forward()
        return -250

    def solve(
        self, alphas: Callable[[int], float], size: Callable[[Any], float], tol: float
    ) -> tuple[int, int, bool]:
        """The proximal steps, the tangents, and whether the last step is at most ``tol``."""
        total = 0
        for number in range(25):
            self.alpha.value = alphas(number)
            count = self.newton()
            total += abs(count)
            moved = size(self.now.x.array[self.to_u] - self.before.x.array[self.to_u])
            if count < 0 or moved <= tol:
                return number + 1, total, count > 0
            self.before.x.array[:] = self.now.x.array
        return 25, total, False


def row(method: str, began: float, counts: tuple[Any, Any, Any], *facts: str) -> list[str]:
    """A row of a table: proximal steps, tangents, whether converged, CPU seconds and facts."""
    steps, tangents, converged = counts
    seconds = f"{time.process_time() - began:.1f}"
    return [method, "yes" if converged else "no", str(steps), str(tangents), seconds, *facts]


def ours(solution: cl.Solution) -> tuple[Any, Any, Any]:
    """The counts of a row."""
    return "", solution.summary["iterations"]["tangents"], solution.converged


def half_sphere(h: float) -> tuple[mesh.Mesh, mesh.MeshTags]:
    """The lower half of the ball of radius 0.4 around (0, 0, 0.5): facets 1 flat, 2 round."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addSphere(0, 0, 0.5, 0.4, angle1=-np.pi / 2, angle2=0)
    gmsh.model.occ.synchronize()
    for dim, face in gmsh.model.getBoundary(gmsh.model.getEntities(3), oriented=False):
        is_flat = np.isclose(gmsh.model.occ.getCenterOfMass(dim, face)[2], 0.5)
        gmsh.model.addPhysicalGroup(2, [face], 1 if is_flat else 2)
    gmsh.model.addPhysicalGroup(3, [entity for _, entity in gmsh.model.getEntities(3)], 1)
    gmsh.model.mesh.field.add("MathEval", 1)
    growth = "0.5*(1 + tanh(10*(sqrt(x^2 + y^2 + (z - 0.1)^2) - 0.3)))"
    gmsh.model.mesh.field.setString(1, "F", f"{h}*(1 + {growth})")
    gmsh.model.mesh.field.setAsBackgroundMesh(1)
    gmsh.model.mesh.generate(3)
    body, _, facets = io.gmshio.model_to_mesh(gmsh.model, COMM, 0)
    gmsh.finalize()
    return body, facets


def signorini() -> list[list[str]]:
    """E = 2e4, nu = 0.3, u = (0, 0, -d) on the flat side; the plane is z = 0."""
    body, facets = half_sphere(0.04)
    lame, mu = 2e4 * 0.3 / 1.3 / 0.4, 2e4 / 2.6
    rows = []
    for down in (0.10, 0.15, 0.20):
        W = fem.functionspace(
            body,
            mixed_element(
                [element("P", "tetrahedron", 2, shape=(3,)), element("P", "tetrahedron", 2)]
            ),
        )
        method = Proximal(W)
        u, psi = ufl.split(method.now)
        forward = psi - ufl.split(method.before)[1]
        v, w = ufl.TestFunctions(W)
        ds = ufl.Measure("ds", body, 2, {"quadrature_degree": 4}, facets)
        e, z = ufl.sym(ufl.grad(u)), ufl.SpatialCoordinate(body)[2]
        sigma = 2 * mu * e + lame * ufl.tr(e) * ufl.Identity(3)
        form = method.alpha * ufl.inner(sigma, ufl.sym(ufl.grad(v))) * ufl.dx
        form += forward * v[2] * ds + (ufl.exp(psi) - z - u[2]) * w * ds
        V = W.sub(0).collapse()[0]
        Q, to_psi = W.sub(1).collapse()
        flat = fem.Function(V)
        flat.interpolate(lambda x, d=down: np.stack([0 * x[0], 0 * x[0], 0 * x[0] - d]))
        dofs = fem.locate_dofs_topological((W.sub(0), V), 2, facets.find(1))
        touching = fem.locate_dofs_topological((W.sub(1), Q), 2, facets.find(2))[0]
        off = np.setdiff1d(np.asarray(to_psi, dtype=np.int32), touching)
        bcs = [fem.dirichletbc(flat, dofs, W.sub(0)), fem.dirichletbc(fem.Function(W), off)]
        began = time.process_time()
        method.prepare(form, bcs, 1e-6)
        counts = method.solve(lambda number: 0.01 * 2.0**number, np.linalg.norm, 1e-6)
        force = abs(fem.assemble_scalar(fem.form(forward / method.alpha * ds)))
        proximal = row("proximal Galerkin", began, counts, f"{force:.1f}")
        began = time.process_time()
        held = fem.dirichletbc(flat, fem.locate_dofs_topological(V, 2, facets.find(1)))
        contact = cl.Contact(facets.find(2), cl.HalfSpace((0, 0, 0), (0, 0, 1)))
        problem = cl.ContactProblem(
            cl.Elasticity(young=2e4, poisson=0.3), None, [held], (), [contact], space=V
        )
        solution = problem.solve(certificate=False)
        force = solution.summary["contact_force"][2]
        exact = row("contact_locking", began, ours(solution), f"{force:.1f}")
        rows += [[f"{down:.2f}", *proximal], ["", *exact]]
    return rows


def scalar_problem(
    body: mesh.Mesh, degree: int, load: Callable[[Any], Any], constraint: Any, axis: int
) -> cl.Solution:
    """-Laplace w = load for a displacement w along an axis, without strain along the other."""
    V = fem.functionspace(body, ("P", degree, (2,)))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    e, f = (ufl.sym(ufl.grad(field)) for field in (u, v))
    across = THIN if axis == 1 else 1.0
    a = (e[0, 0] * f[0, 0] + 4 * e[0, 1] * f[0, 1] + across * e[1, 1] * f[1, 1]) * ufl.dx
    L = load(ufl.SpatialCoordinate(body)) * v[axis] * ufl.dx
    other, space = V.sub(1 - axis), V.sub(1 - axis).collapse()[0]
    everywhere = fem.locate_dofs_geometrical((other, space), lambda x: x[0] > -1)
    ends = fem.locate_dofs_geometrical(V, constraint["ends"])
    bcs = [
        fem.dirichletbc(fem.Function(space), everywhere, other),
        fem.dirichletbc(np.zeros(2), ends, V),
    ]
    problem = cl.ContactProblem(
        a, L, bcs, constraint.get("limits", ()), constraint.get("contacts", ())
    )
    return problem.solve(certificate=False)


# A strip of the obstacle problem is so stiff across that both of its sides have one displacement.
THIN = 1e6
GRADIENT = cl.Weighted(((1, 0, 0), (0, 1, 0), (0, 0, np.sqrt(2.0))), "0.1 + 0.2*x + 0.4*y")


def bump(x: Any) -> Any:
    """The load of the limits of the gradient."""
    return 15.0 * ufl.sin(ufl.pi * x[0]) ** 2


def gradient_limit() -> list[list[str]]:
    """-Laplace w = 15 sin(pi x)^2, |grad w| <= phi = 0.1 + 0.2 x + 0.4 y, on 40 x 40 squares."""
    body = mesh.create_unit_square(COMM, 40, 40)
    began = time.process_time()
    P2, latent = element("P", "triangle", 2), element("P", "triangle", 1, shape=(2,))
    W = fem.functionspace(body, mixed_element([P2, latent]))
    method = Proximal(W)
    (w, psi), (old, psi_old) = ufl.split(method.now), ufl.split(method.before)
    v, t = ufl.TestFunctions(W)
    x = ufl.SpatialCoordinate(body)
    phi = 0.1 + 0.2 * x[0] + 0.4 * x[1]
    dx = ufl.Measure("dx", body, metadata={"quadrature_degree": 10})
    form = method.alpha * (ufl.inner(ufl.grad(w), ufl.grad(v)) - bump(x) * v) * dx
    form += ufl.inner(psi - psi_old, ufl.grad(v)) * dx
    bounded = phi * psi / ufl.sqrt(1 + ufl.inner(psi, psi))
    form += ufl.inner(ufl.grad(w) - bounded, t) * dx
    V, _ = W.sub(0).collapse()
    body.topology.create_connectivity(1, 2)
    edges = mesh.exterior_facet_indices(body.topology)
    dofs = fem.locate_dofs_topological((W.sub(0), V), 1, edges)
    method.prepare(form, [fem.dirichletbc(fem.Function(V), dofs, W.sub(0))], 1e-9)
    change = fem.form((w - old) ** 2 * dx)
    counts = method.solve(
        lambda number: 2.0**number, lambda _: float(np.sqrt(fem.assemble_scalar(change))), 1e-8
    )

    def facts(field: Any) -> tuple[str, str]:
        """The energy, and by how much the limit is exceeded, relative, at many points."""
        slope = ufl.grad(field)
        energy = fem.form((0.5 * ufl.inner(slope, slope) - bump(x) * field) * dx)
        points = fem.functionspace(body, ("DG", 4))
        excess = fem.Function(points)
        value = ufl.sqrt(ufl.inner(slope, slope)) / phi - 1.0
        excess.interpolate(fem.Expression(value, points.element.interpolation_points()))
        return f"{fem.assemble_scalar(energy):.6f}", f"{max(0.0, excess.x.array.max()):.0e}"

    rows = [row("proximal Galerkin, P2", began, counts, *facts(w))]
    for degree in (1, 2):
        began = time.process_time()

        def ends(x: Any) -> Any:
            return np.isclose(x[:2] * (1 - x[:2]), 0).any(axis=0)

        limits = {"ends": ends, "limits": [GRADIENT]}
        solution = scalar_problem(body, degree, bump, limits, axis=0)
        told = facts(solution.displacement[0])
        rows.append(row(f"contact_locking, P{degree}", began, ours(solution), *told))
    return rows


def in_one_dimension() -> list[list[str]]:
    """-w'' = -8, w >= -1/2, and -w'' = 15 sin(pi x)^2, |w'| <= 0.1 + 0.2 x; w = 0 at both ends."""
    cells, rows = 200, []
    line, x = mesh.create_unit_interval(COMM, cells), np.linspace(0, 1, cells + 1)
    touch = np.sqrt(0.125)  # w = 4 x^2 - 8 touch x up to there
    fine = np.linspace(0, 1, 200 * cells + 1)
    load = 7.5 * fine - 15 * np.sin(2 * np.pi * fine) / (4 * np.pi)
    middle = 0.5 * (load[1:] + load[:-1])
    bound = 0.1 + 0.1 * (fine[1:] + fine[:-1])

    def slopes(constant: float) -> Any:
        return np.clip(constant - middle, -bound, bound)

    constant = brentq(lambda c: slopes(c).sum(), 0.0, 7.5)
    exact = {
        "obstacle": np.where(
            np.minimum(x, 1 - x) < touch,
            4 * np.minimum(x, 1 - x) ** 2 - 8 * touch * np.minimum(x, 1 - x),
            -0.5,
        ),
        "gradient": np.append(0.0, np.cumsum(slopes(constant)) * (fine[1] - fine[0]))[::200],
    }
    for name, values in exact.items():
        began = time.process_time()
        W = fem.functionspace(
            line, mixed_element([element("P", "interval", 1), element("DG", "interval", 0)])
        )
        if name == "obstacle":
            W = fem.functionspace(line, mixed_element([element("P", "interval", 1)] * 2))
        method = Proximal(W)
        (w, psi), alpha = ufl.split(method.now), method.alpha
        v, t = ufl.TestFunctions(W)
        place, old = ufl.SpatialCoordinate(line), ufl.split(method.before)[1]
        if name == "obstacle":
            form = alpha * (ufl.inner(ufl.grad(w), ufl.grad(v)) + 8 * v) * ufl.dx
            form += (psi - old) * v * ufl.dx + (w + 0.5 - ufl.exp(psi)) * t * ufl.dx
        else:
            form = alpha * (ufl.inner(ufl.grad(w), ufl.grad(v)) - bump(place) * v) * ufl.dx
            form += (psi - old) * v.dx(0) * ufl.dx
            bounded = (0.1 + 0.2 * place[0]) * psi / ufl.sqrt(1 + psi**2)
            form += (w.dx(0) - bounded) * t * ufl.dx
        V, to_w = W.sub(0).collapse()
        dofs = fem.locate_dofs_geometrical(
            (W.sub(0), V), lambda x: np.isclose(x[0] * (1 - x[0]), 0)
        )
        method.prepare(form, [fem.dirichletbc(fem.Function(V), dofs, W.sub(0))], 1e-9)
        counts = method.solve(lambda number: 2.0**number, lambda move: np.abs(move).max(), 1e-8)
        order = np.argsort(V.tabulate_dof_coordinates()[:, 0])
        error = np.abs(method.now.x.array[to_w][order] - values).max()
        rows.append([name, *row("proximal Galerkin", began, counts, f"{error:.0e}")])
        began = time.process_time()
        strip = mesh.create_rectangle(COMM, [[0, 0], [1, 1 / cells]], [cells, 1])
        constraint: dict[str, Any] = {"ends": lambda x: np.isclose(x[0] * (1 - x[0]), 0)}
        if name == "obstacle":
            below = mesh.locate_entities_boundary(strip, 1, lambda x: np.isclose(x[1], 0))
            constraint["contacts"] = [cl.Contact(below, cl.HalfSpace((0, -0.5), (0, 1)))]
            solution = scalar_problem(strip, 1, lambda x: -8.0, constraint, axis=1)
        else:
            constraint["limits"] = [cl.Weighted(GRADIENT.matrix, "0.1 + 0.2*x")]
            solution = scalar_problem(strip, 1, bump, constraint, axis=0)
        places = solution.displacement.function_space.tabulate_dof_coordinates()
        low = np.flatnonzero(np.isclose(places[:, 1], 0))
        low = low[np.argsort(places[low, 0])]
        found = solution.displacement.x.array.reshape(-1, 2)[low, 1 if name == "obstacle" else 0]
        error = np.abs(found - values).max()
        rows.append(["", *row("contact_locking", began, ours(solution), f"{error:.0e}")])
    return rows


# conmech's study: the normal compliance is linear up to a penetration of 0.1, with this slope.
SLOPE = (0.1 + np.exp(-0.1)) / 0.1
BRIDGE = (
    *((0.0, 0.2), (0.2, 0.4), (0.6, 0.4), (0.8, 0.2), (0.8, 0.0), (1.2, 0.0)),
    *((1.2, 1.2), (0.8, 1.2), (0.8, 1.0), (0.6, 0.8), (0.2, 0.8), (0.0, 1.0)),
)
# Its published errors, in its own norm, at 1/lambda.
PUBLISHED = {
    2048: 0.13217099205041302,
    8192: 0.036147047768223,
    32768: 0.01010466081623074,
    131072: 0.003309243652330325,
    1048576: 0.0013620445313966081,
    8388608: 0.0011019352332271976,
}


def penalties() -> list[list[str]]:
    """A bridge that is held at x = 0, under its weight, on a foundation at y = 0 that yields.

    The friction bound is the penetration u_nu, which is Coulomb's with the coefficient u_nu/p.
    """
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    corners = [gmsh.model.occ.addPoint(*place, 0, 1 / 32) for place in BRIDGE]
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    lines = [gmsh.model.occ.addLine(*pair) for pair in pairs]
    gmsh.model.occ.addPlaneSurface([gmsh.model.occ.addCurveLoop(lines)])
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1], 1)
    gmsh.model.mesh.generate(2)
    body, *_ = io.gmshio.model_to_mesh(gmsh.model, COMM, 0, gdim=2)
    gmsh.finalize()
    V = fem.functionspace(body, ("P", 1, (2,)))
    held = fem.dirichletbc(
        np.zeros(2), fem.locate_dofs_geometrical(V, lambda x: np.isclose(x[0], 0)), V
    )
    sole = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], 0))
    mu, lame = 12000 / 1.42, 12000 * 0.42 / 1.42 / 0.16
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    e, f = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))
    a = (2 * mu * ufl.inner(e, f) + lame * ufl.tr(e) * ufl.tr(f)) * ufl.dx
    L = ufl.inner(fem.Constant(body, (-200.0, -800.0)), v) * ufl.dx

    def solve(inverse: float) -> cl.Solution:
        compliance = 0.0 if np.isinf(inverse) else 1 / (SLOPE * inverse)
        friction = cl.Coulomb(compliance, cl.Local())
        contact = cl.Contact(sole, cl.HalfSpace((0, 0), (0, 1)), friction)
        problem = cl.ContactProblem(a, L, [held], (), [contact], compliance=compliance)
        return problem.solve(certificate=False)

    limit, rows, first = solve(np.inf), [], 0.0
    for inverse, error in PUBLISHED.items():
        solution = solve(float(inverse))
        away = solution.distance(limit)["energy_norm"]
        first = first or away
        deepest = solution.summary["penetration_max"]
        assert solution.converged and deepest < 0.1
        shares = (away / first, error / PUBLISHED[2048])
        tangents = str(solution.summary["iterations"]["tangents"])
        rows.append([str(inverse), tangents, f"{deepest:.1e}", *(f"{x:.1e}" for x in shares)])
    return rows


def two_blocks() -> list[list[str]]:
    """Two unit cubes of E = 100 and nu = 0.3, pressed on each other by 0.1, without friction."""
    rows = []
    for h in (0.25, 0.125, 0.0625):
        began = time.process_time()
        study = cl.from_mapping(
            {
                "mesh": {"builder": "stack", "dim": 3, "size": [1, 1, 1], "h": h, "cells": "box"}
                | {"structured": True, "h_upper": 0.7 * h},
                "material": {"elasticity": {"young": 100, "poisson": 0.3}},
                "loads": {
                    "displacements": [
                        {"on": "bottom", "value": [0, 0, 0]},
                        {"on": "top", "value": [0, 0, -0.1]},
                    ]
                },
                "contact": {"on": "upper_bottom", "against": "lower_top"},
                "friction": {"coefficient": 0},
                "penalty": {"n": "inf"},
            }
        )
        solution = cl.solve(study)
        force = solution.summary["contact_force"][2]
        size = str(solution.summary["dofs"])
        rows.append([size, *row("contact_locking", began, ours(solution), f"{force:.4f}")])
    return rows


def table(header: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    common = ["method", "converges", "proximal steps", "tangents", "s"]
    texts = ["# Problems of others, by `benchmarks/peers/published.py`"]
    for title, rows, before, after in (
        ("Half sphere on a plane", signorini, ["d"], ["force"]),
        ("Limit of the gradient", gradient_limit, [], ["energy", "excess"]),
        ("One dimension", in_one_dimension, ["problem"], ["largest error"]),
        ("Two blocks", two_blocks, ["unknowns"], ["force"]),
    ):
        texts += [f"## {title}", table([*before, *common, *after], rows())]
        print(texts[-1], flush=True)
    header = [
        "1/lambda",
        "tangents",
        "penetration",
        "error, of the first",
        "conmech's, of its first",
    ]
    texts += ["## conmech's penalties", table(header, penalties())]
    print(texts[-1], flush=True)
    Path(__file__).with_suffix(".md").write_text("\n\n".join(texts) + "\n", encoding="utf-8")
