# %% [markdown]
# # A law of your own: fibres that straighten
#
# Cartilage is a soft matrix with collagen fibres. The fibres are crimped: a stretch up to $M$ only
# straightens them, then they resist any further stretch, and under compression they do nothing.
# Along the unit vector $a$ of its fibres the tissue stretches by $a \cdot \varepsilon a$. So its
# strain is held not in the ball $|\varepsilon| \le M$ but in another convex set, a half space that
# is different at every point:
#
# $$K(x) = \{\varepsilon : a(x) \cdot \varepsilon\, a(x) \le M\}.$$
#
# No study file can express this law. A law that is the derivative of a convex energy can be added
# from Python, as one function in UFL. Everything else stays: the mesh, contact and friction, the
# solver, the certificate, MPI. Like the energy of the ball (23), the energy is made from the
# distance to the set:
#
# $$J(u) = \int_\Omega n\,\bigl([a \cdot \varepsilon(u) a - M]^+\bigr)^2, \qquad
#   J'(u) v = \int_\Omega Z : \varepsilon(v), \qquad
#   Z = 2n\,[a \cdot \varepsilon a - M]^+\, a \otimes a.$$
#
# $Z$ is the tension of the fibres. The layer is 2 wide and 0.5 thick; it is glued to the bone on
# its top, which presses it on a round indenter below.

# %%
import dataclasses
import math
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from matplotlib.collections import LineCollection, PolyCollection
from mpi4py import MPI

from contact_locking import Solution, assemble, load, solve, solve_assembled, write
from contact_locking.laws.convex import positive_part
from contact_locking.laws.elasticity import strain

FloatArray = npt.NDArray[np.float64]

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
THICKNESS = 0.5
SLACK = 0.01  # M

comm = MPI.COMM_WORLD

# %% [markdown]
# ## The matrix alone
#
# The study file describes the tissue without fibres.

# %%
parameters = load(FILE, CHANGES).parameters
matrix = solve(parameters, comm)
write(matrix, parameters.output.directory)
assert matrix.converged, matrix.summary["reason"]

# %% [markdown]
# ## The law
#
# This function is the direction of the fibres in UFL. In cartilage the fibres form arcades: they
# rise from the bone and bend over to run along the surface. For comparison there are fibres that
# all run along the surface, and fibres that are all perpendicular to it.


# %%
def direction(x: Any, kind: str) -> Any:
    """The unit vector of the fibres at x; y = 0 is the surface."""
    angle = {
        "arcades": 0.5 * math.pi * x[1] / THICKNESS,
        "along": 0.0 * x[1],
        "upright": 0.5 * math.pi + 0.0 * x[1],
    }[kind]
    return ufl.as_vector([ufl.cos(angle), ufl.sin(angle)])


def stretch(u: Any, a: Any) -> Any:
    return ufl.inner(ufl.outer(a, a), strain(u))


# %% [markdown]
# `assemble` makes the discrete problem of the parameters, `solve_assembled` solves it, and between
# the two the energy is put into its data. The constant `data.n` is the penalty $n$ of the study
# file; a law that uses it takes part in the solver's way from a soft to a stiff penalty. One
# quadrature point suffices, as the strain of linear elements is constant in a cell.
#
# The energy has to be convex, differentiable and least for $u = 0$. Newton's method solves the
# problem; UFL computes the derivatives. The criteria of the certificate stay as they are, with $J'$
# in the equilibrium. The proved bounds do not apply any more, and the summary says so.


# %%
def one_point(problem_mesh: Any) -> ufl.Measure:
    return ufl.Measure("dx", domain=problem_mesh, metadata={"quadrature_degree": 1})


def solve_with_fibres(kind: str, slack: float, *changes: str) -> Solution:
    problem = assemble(load(FILE, [*CHANGES, *changes]).parameters, comm)
    mesh, n = problem.domain.mesh, problem.data.n
    a, dx = direction(ufl.SpatialCoordinate(mesh), kind), one_point(mesh)

    def energy(u: fem.Function) -> Any:
        return n * positive_part(stretch(u, a) - slack) ** 2 * dx

    problem.data = dataclasses.replace(problem.data, own_energy=energy)
    solution = solve_assembled(problem)
    assert solution.converged, solution.summary["reason"]
    return solution


def stretches(solution: Solution, kind: str) -> FloatArray:
    """Of the fibres in the cells that this rank owns."""
    mesh = solution.domain.mesh
    a, dx = direction(ufl.SpatialCoordinate(mesh), kind), one_point(mesh)
    cells = solution.strain_norm.function_space
    w = ufl.TestFunction(cells)
    total, volume = (
        fem.assemble_vector(fem.form(f * w * dx)).array
        for f in (stretch(solution.displacement, a), fem.Constant(mesh, 1.0))
    )
    owned = mesh.topology.index_map(2).size_local
    return np.asarray((total / volume)[cells.dofmap.list[:owned, 0]])


def largest(solution: Solution, kind: str) -> float:
    return float(comm.allreduce(stretches(solution, kind).max(initial=-1.0), op=MPI.MAX))


# %% [markdown]
# ## What the fibres do
#
# Pressed from below, the layer gives way to the sides, and its surface is stretched. Upright
# fibres are compressed over the indenter, stay crimped beside it, and change nothing. Fibres along
# the surface lock: the tissue can no longer give way, and the same indentation takes 1.6 times the
# force. The arcades lie between the two: they hold the surface, and let the depth go.

# %%
kinds = ("upright", "arcades", "along")
solutions = {kind: solve_with_fibres(kind, SLACK) for kind in kinds}


def force(solution: Solution) -> float:
    return float(solution.summary["contact_force"][1])


if comm.rank == 0:
    print(f"{'fibres':>8}  force    largest pressure")
    for name, solution in {"none": matrix, **solutions}.items():
        assert solution.contact_points is not None
        peak = solution.contact_points.pressure.max()
        print(f"{name:>8}  {force(solution):.5f}  {peak:.4f}")
assert abs(force(solutions["upright"]) / force(matrix) - 1) < 1e-3
assert force(solutions["arcades"]) > 1.1 * force(matrix)
assert force(solutions["along"]) > 1.4 * force(matrix)
for kind in ("arcades", "along"):
    assert largest(matrix, kind) > 3 * SLACK
    assert largest(solutions[kind], kind) < 1.01 * SLACK

# %% [markdown]
# The pictures show how far the fibres are stretched: red ones are straight and carry load. Strokes
# show their directions. The deformed bodies are drawn as they are, not magnified.


# %%
def drawing(solution: Solution, kind: str) -> tuple[FloatArray, FloatArray] | None:
    """Deformed triangles (c, 3, 2) and stretches (c,) on rank 0."""
    u = solution.displacement
    values = stretches(solution, kind)
    corners = u.function_space.dofmap.list[: len(values)]
    x = u.function_space.tabulate_dof_coordinates()[:, :2] + u.x.array.reshape(-1, 2)
    parts = comm.gather((x[corners], values))
    if parts is None:
        return None
    triangles, numbers = (np.concatenate(part) for part in zip(*parts, strict=True))
    return triangles, numbers


def strokes(kind: str) -> FloatArray:
    """Short lines (m, 2, 2) along the fibres."""
    x, y = (
        grid.ravel() for grid in np.meshgrid(np.arange(0.05, 2, 0.1), np.arange(0.04, 0.45, 0.1))
    )
    angle = {
        "arcades": 0.5 * np.pi * y / THICKNESS,
        "along": 0.0 * y,
        "upright": 0.5 * np.pi + 0.0 * y,
    }
    step = 0.03 * np.stack([np.cos(angle[kind]), np.sin(angle[kind])], axis=1)
    middle = np.stack([x, y], axis=1)
    return np.stack([middle - step, middle + step], axis=1)


panels = {kind: drawing(solutions[kind], kind) for kind in kinds}
if comm.rank == 0:
    figure, axes = plt.subplots(3, 1, figsize=(7, 6.4), sharex=True, layout="constrained")
    for ax, (kind, panel) in zip(axes, panels.items(), strict=True):
        assert panel is not None
        body = PolyCollection(
            list(panel[0]), array=panel[1] / SLACK, cmap="RdBu_r", edgecolors="face"
        )
        body.set_clim(-1.0, 1.0)
        ax.add_collection(body)
        ax.add_collection(
            LineCollection(list(strokes(kind)), colors="black", linewidths=0.7, alpha=0.6)
        )
        angles = np.linspace(-0.6, 0.6, 100) + 0.5 * np.pi
        ax.fill(1.0 + 2.0 * np.cos(angles), -2.0 + 2.0 * np.sin(angles), color="0.8")
        ax.set(xlim=(-0.05, 2.05), ylim=(-0.1, 0.52), aspect="equal", title=f"Fibres: {kind}")
    figure.colorbar(body, ax=axes, label=r"stretch of the fibres $a \cdot \varepsilon a/M$")
    figure.savefig(Path(parameters.output.directory) / "fibres.png", dpi=150)

# %% [markdown]
# ## Soft, then stiff
#
# Tissue is soft as long as its fibres are crimped. In the first steps of indentation the curve
# follows the curve of the matrix, and leaves it when the first fibres are straight.

# %%
stiffening = []
for depth in (0.002, 0.004, 0.01, 0.02, 0.03):
    pressed = f"loads.displacements.0.value=[0, {-depth}]"
    without = solve(load(FILE, [*CHANGES, pressed]).parameters, comm)
    fibres = solve_with_fibres("along", SLACK, pressed)
    stiffening.append(force(fibres) / force(without))
    if comm.rank == 0:
        print(
            f"pressed by {depth:.3f}: force {force(fibres):.5f}, {stiffening[-1]:.2f} x the matrix"
        )
assert abs(stiffening[0] - 1) < 1e-3
assert all(np.diff(stiffening) > 0)

# %% [markdown]
# ## Is it right?
#
# The penalty lets the strain leave $K$ a little, by a distance that falls like $1/n$.

# %%
excess = []
for n in (1e3, 1e4, 1e5):
    solution = solve_with_fibres("arcades", SLACK, f"penalty.n={n:g}", "penalty.epsilon=1e-5")
    excess.append(largest(solution, "arcades") / SLACK - 1)
    if comm.rank == 0:
        print(f"n = {n:7g}  largest stretch/M - 1 = {excess[-1]:.1e}")
factors = np.divide(excess[:-1], excess[1:])
assert ((factors > 5) & (factors < 20)).all(), factors

# %% [markdown]
# Other laws are added in the same way: a bound on the change of volume, as of packed grains that
# jam, $n([M + \operatorname{tr}\varepsilon]^-)^2$; springs on a part of the boundary; a stiffer
# matrix, $\tfrac14 c\,|\varepsilon|^4$. A friction law, whose bound depends on the solution, is
# added in another way: see the guide [A law of your own](../guides/law.md).
