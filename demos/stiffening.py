# %% [markdown]
# # How do I add a law of my own, such as tissue that stiffens?
#
# A body that locks is elastic up to its limit and yields no more beyond it. Many tissues stiffen
# gradually instead. A simple energy for that is
#
# $$J(u) = \int_\Omega \tfrac14 c\, |\varepsilon(u)|^4, \qquad
#   J'(u) v = \int_\Omega c\, |\varepsilon(u)|^2\, \varepsilon(u) : \varepsilon(v).$$
#
# No study file can express this law. A law that is the derivative of a convex energy can be added
# from Python, as one function in UFL. Everything else stays: the mesh, contact and friction, the
# solver, the certificate, MPI.
#
# The layer is 2 wide and 0.5 thick; it is glued to the bone on its top, which presses it on a round
# indenter below.

# %%
import dataclasses
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from contact_locking import StudySolution, assemble, load, solve, solve_assembled, write
from contact_locking.laws.body import squared_norm, strain
from contact_locking.running.assembly import StudyProblem

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
STIFFENING = 200.0  # c: the law is as stiff as the layer where |eps| is about 0.07

comm = MPI.COMM_WORLD

# %% [markdown]
# ## The layer without the law
#
# The study file describes the linear elastic layer.

# %%
parameters = load(FILE, CHANGES).parameters
linear = solve(parameters, comm)
write(linear, parameters.output.directory)
assert linear.converged, linear.summary["reason"]

# %% [markdown]
# ## The law
#
# `assemble` makes the discrete problem of the parameters, `solve_assembled` solves it, and between
# the two the energy is put into its data. The energy has to be convex, differentiable and least for
# $u = 0$. UFL computes the derivatives, and the solver is that of every study. One quadrature point
# suffices, as the strain of linear elements is constant in a cell.
#
# The criteria of the certificate stay as they are, with $J'$ in the equilibrium. The proved bounds
# do not apply any more, and the summary says so.


# %%
def with_law(c: float, *changes: str) -> StudyProblem:
    problem = assemble(load(FILE, ["penalty.n=.inf", *CHANGES, *changes]).parameters, comm)
    dx = ufl.Measure("dx", problem.domain.mesh, metadata={"quadrature_degree": 1})
    stiffness = fem.Constant(problem.domain.mesh, c)

    def energy(u: fem.Function) -> Any:
        return 0.25 * stiffness * squared_norm(strain(u)) ** 2 * dx

    problem.data = dataclasses.replace(problem.data, own_energy=energy)
    return problem


def solve_stiffening(problem: StudyProblem) -> StudySolution:
    solution = solve_assembled(problem)
    assert solution.converged, solution.summary["reason"]
    return solution


def force(solution: StudySolution) -> float:
    return float(solution.summary["contact_force"][1])


def largest(solution: StudySolution) -> float:
    return float(solution.summary["strain_norm_max"])


stiffening = solve_stiffening(with_law(STIFFENING))
if comm.rank == 0:
    for name, solution in (("linear", linear), ("stiffening", stiffening)):
        print(f"{name:>10}: force {force(solution):.5f}, largest strain {largest(solution):.4f}")
    print(stiffening.summary["bounds"]["displacement_norm"]["reason"])
assert force(stiffening) > 1.2 * force(linear)
assert largest(stiffening) < 0.9 * largest(linear)

# %% [markdown]
# ## Soft, then stiff
#
# Beside the law stands a layer that locks: its limit is a line of the study file. Up to some depth
# both follow the linear layer. Then the layer that locks leaves it at once, where the first cells
# reach their limit, and the other gradually.

# %%
depths = (0.003, 0.015, 0.03)
curves: dict[str, list[float]] = {"stiffening": [], "locking": []}
for depth in depths:
    pressed = f"loads.displacements.0.value=[0, {-depth}]"
    reference = force(solve(load(FILE, [*CHANGES, pressed]).parameters, comm))
    limited = load(FILE, [*CHANGES, pressed, "material.locking_limit=0.08"]).parameters
    stiff = solve_stiffening(with_law(STIFFENING, pressed))
    curves["stiffening"].append(force(stiff) / reference)
    curves["locking"].append(force(solve(limited, comm)) / reference)
    if comm.rank == 0:
        ratios = ", ".join(f"{name} {values[-1]:.3f}" for name, values in curves.items())
        print(f"pressed by {depth:.3f}: force over that of the linear layer: {ratios}")
assert all(np.diff(curves["stiffening"]) > 0)
assert curves["stiffening"][0] < 1.05
assert abs(curves["locking"][0] - 1) < 1e-3

# %%
if comm.rank == 0:
    figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
    for name, values in curves.items():
        ax.plot(depths, values, "o-", label=name)
    ax.set(xlabel="depth", ylabel="force over that of the linear layer")
    ax.legend(frameon=False)
    figure.savefig(Path(parameters.output.directory) / "stiffening.png", dpi=150)

# %% [markdown]
# ## Is it right?
#
# Without friction and penalties the layer minimises its energy $E(u) + c\,J_1(u)$. At the minimiser
# the energy has no slope, so that the derivative of the least energy in c is $J_1(u)$. The
# difference of the least energies for c + 1 and c - 1 shows that.

# %%
energies, slope = [], 0.0
for c in (9.0, 10.0, 11.0):
    problem = with_law(c, "friction.coefficient=0")
    solution = solve_stiffening(problem)
    own = problem.data.own_energy
    assert own is not None
    stored = float(comm.allreduce(fem.assemble_scalar(fem.form(own(solution.displacement)))))
    energies.append(solution.summary["elastic_energy"] + stored)
    if c == 10.0:
        slope = stored / c
difference = 0.5 * (energies[2] - energies[0])
if comm.rank == 0:
    print(f"slope of the energy in c: {difference:.6e}, and J_1(u) = {slope:.6e}")
assert abs(difference / slope - 1.0) < 1e-4

# %% [markdown]
# Other laws are added in the same way, such as springs on a part of the boundary. A set of strains
# that is described by a norm or by a half space needs no energy: it is an entry of
# `material.locking` (demo [fabric](fabric.ipynb)), or an object of your own. A friction law, whose
# bound depends on the solution, is added in another way: see the guide
# [A law of your own](../guides/law.md).
