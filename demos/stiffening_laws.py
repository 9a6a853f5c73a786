# %% [markdown]
# # Does it matter whether a material stiffens gently or locks at once?
#
# Rubber and tissue stiffen before they reach the limit of their strain. With
# $s = |\varepsilon|^2/M^2$, laws in the manner of Gent (doi:10.5254/1.3538357) and of Rajagopal's
# bodies with bounded strains are
#
# $$\sigma = \frac{E\,\varepsilon}{1 - s} \qquad\text{and}\qquad
#   \sigma = \frac{E\,\varepsilon}{\sqrt{1-s}}, \quad\text{which is}\quad
#   \varepsilon = \frac{\sigma/E}{\sqrt{1 + |\sigma|^2/(EM)^2}} .$$
#
# A share $\theta$ of their stiffening, $\sigma = E\varepsilon\,(1 + \theta f'(s))$, has a convex
# energy, which `ContactProblem` takes as `energy=`:
#
# $$J_\theta(u) = \tfrac12\theta E M^2 \int_\Omega f(s), \qquad
#   f = -\ln(1-s) - s \quad\text{or}\quad f = 2 - 2\sqrt{1-s} - s .$$
#
# For $\theta \to 0$ the stiffening retreats to $|\varepsilon| = M$, and $u_\theta$ tends to the
# solution that locks, as $u_n$ does for the penalty $n \to \infty$ in Theorem 4.9 of the paper.
#
#     python demos/stiffening_laws.py 0.08 48        depth over the thickness, cells along the layer

# %%
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from scipy.optimize import brentq

import contact_locking as cl

DEPTH, CELLS = (float(word) for word in sys.argv[1:] or (0.08, 48))
comm, cells, M, crossed = MPI.COMM_WORLD, int(CELLS), 0.1, mesh.DiagonalType.crossed
LAWS: dict[str, Any] = {  # f and its derivative
    "Gent": (lambda s: -ufl.ln(1 - s) - s, lambda s: s / (1 - s)),
    "Rajagopal": (lambda s: 2 - 2 * ufl.sqrt(1 - s) - s, lambda s: 1 / np.sqrt(1 - s) - 1),
}
ELASTIC = cl.Elasticity(young=1.0, poisson=0.0)
EDGE = 1 - 1e-6  # from here on f is linear: an iterate may strain beyond M


def solve(V: Any, law: str, thetas: Any, bcs: Any, L: Any = None, contacts: Any = ()) -> Any:
    """The solutions for E = 1 and nu = 0 by thetas that fall, each started from the one before."""
    (f, slope), theta, dx = LAWS[law], fem.Constant(V.mesh, 1.0), ufl.dx(domain=V.mesh, degree=1)

    def energy(u: Any) -> Any:
        s = ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(u))) / M**2
        inside = ufl.conditional(ufl.lt(s, EDGE), s, EDGE)
        return 0.5 * theta * M**2 * (f(inside) + slope(EDGE) * (s - inside)) * dx

    problem = cl.ContactProblem(ELASTIC, L, bcs, (), contacts, space=V, energy=energy)
    solutions: list[Any] = [None]
    for theta.value in thetas:
        solutions.append(problem.solve(start=solutions[-1], certificate=False))
        assert solutions[-1].converged, solutions[-1].summary["reason"]
    problem.close()
    return solutions[1:]


# %% [markdown]
# ## A column under its weight, as a check
#
# At the height y the stress is $0.2\,(1-y)$, and the strain solves a scalar equation.

# %%
column = mesh.create_rectangle(comm, [[0, 0], [0.1, 1]], [1, cells], diagonal=crossed)
V = fem.functionspace(column, ("P", 1, (2,)))
foot = mesh.locate_entities_boundary(column, 1, lambda x: np.isclose(x[1], 0))
clamp = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, foot), V)
load = -fem.Constant(column, 0.2) * ufl.TestFunction(V)[1] * ufl.dx
stresses = 0.2 * (np.arange(cells) + 0.5) / cells  # in the middle of each row of cells


def strain(law: str, theta: float, stress: float) -> float:
    """The strain of the law in one dimension."""
    slope, most = LAWS[law][1], M * (1 - 1e-14)
    return brentq(lambda e: e * (1 + theta * slope((e / M) ** 2)) - stress, 0, most)


THETAS = (1.0, 0.3, 0.1, 0.03, 0.01)
for law in LAWS:
    for theta, solution in zip(THETAS, solve(V, law, THETAS, [clamp], load), strict=True):
        sunk = -solution.displacement.x.array.min()
        exact = np.mean([strain(law, theta, stress) for stress in stresses])
        print(f"{law:9}  theta = {theta:4g}: sinks by {sunk:.6f} (exact {exact:.6f})")
        assert abs(sunk / exact - 1) < 1e-3

# %% [markdown]
# ## A layer under a cylinder
#
# Let $E(v) = \frac12 a(v, v) = \frac12 \|v\|^2$. The solution u that locks is least for E among
# strains up to M, so that $\frac12\|u_\theta - u\|^2 \le E(u_\theta) - E(u)$. This is at most
# $J_\theta(u)$, as $u_\theta$ is least for $E + J_\theta$. Hence
# $\|u_\theta - u\|^2 \le \theta E M^2 \int_\Omega f(s)$, with $f \le 1$ for Rajagopal's law.

# %%
layer = mesh.create_rectangle(comm, [[-2, 0], [2, 1]], [cells, cells // 4], diagonal=crossed)
V = fem.functionspace(layer, ("P", 1, (2,)))
bottom = mesh.locate_entities_boundary(layer, 1, lambda x: np.isclose(x[1], 0))
clamp = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V)
top = mesh.locate_entities_boundary(layer, 1, lambda x: np.isclose(x[1], 1) & (abs(x[0]) < 1.5))
contact = cl.Contact(top, cl.Sphere((0, 2 - DEPTH), 1))
sharp = cl.ContactProblem(ELASTIC, None, [clamp], [cl.StrainBall(M)], [contact], space=V)
limit = sharp.solve(certificate=False)
assert limit.converged, limit.summary["reason"]
runs = {law: solve(V, law, THETAS, [clamp], None, [contact]) for law in LAWS}
far = {law: [run.distance(limit)["energy_norm"] for run in runs[law]] for law in LAWS}
for law in LAWS:
    rates = np.diff(np.log(far[law])) / np.diff(np.log(THETAS))
    print(f"{law:9}  distances to the limit", np.round(far[law], 5), "rates", np.round(rates, 2))
    assert (rates > 0.3).all() and rates[-1] > 0.5
bound = M * np.sqrt(4.0 * np.array(THETAS))  # the area is 4
assert (far["Rajagopal"] < bound).all()

# %%
shown = {"Gent": runs["Gent"][0], "Gent, θ = 0.1": runs["Gent"][2], "|ε| ≤ M": limit}
layout: Any = [[name for name in shown for _ in range(2)], ["laws"] * 3 + ["rates"] * 3]
figure, axes = plt.subplot_mosaic(layout, figsize=(8, 4.6), layout="constrained")
dofs, cell = V.tabulate_dof_coordinates()[:, :2], V.dofmap.list
for name, solution in shown.items():
    moved = (dofs + solution.displacement.x.array.reshape(-1, 2)).T
    strains = solution.strain_norm.x.array.reshape(len(cell), -1).max(axis=1) / M
    image = axes[name].tripcolor(*moved, cell, facecolors=strains, cmap="magma_r", vmin=0, vmax=1)
    axes[name].add_patch(plt.Circle((0, 2 - DEPTH), 1, color="0.6"))
    force = -solution.summary["contact_force"][1]
    axes[name].set(
        aspect="equal", xlim=(-1.6, 1.6), ylim=(0, 1.6), title=f"{name}: F = {force:.3f}"
    )
    axes[name].axis("off")
figure.colorbar(image, ax=[axes[name] for name in shown], label="|ε| / M")
stress = np.linspace(0.001, 3 * M, 300)
for law, colour in zip(LAWS, ("C0", "C1"), strict=True):
    for theta, line in ((1.0, "-"), (0.1, "--")):
        eps = np.array([strain(law, theta, value) for value in stress])
        label = f"{law}, θ = {theta:g}"
        axes["laws"].plot(eps / M, stress / M, line, color=colour, label=label)
    axes["rates"].loglog(THETAS, far[law], "o-", color=colour, label=law)
axes["laws"].plot(np.minimum(stress / M, 1), stress / M, "k", lw=1, label="|ε| ≤ M")
axes["laws"].set(xlabel="ε / M", ylabel="σ / E M")
axes["rates"].loglog(THETAS, bound, "k:", label="bound")
axes["rates"].set(xlabel="θ", ylabel="distance to the limit")
for name in ("laws", "rates"):
    axes[name].legend(frameon=False, fontsize=9)
Path("results").mkdir(exist_ok=True)
figure.savefig("results/stiffening_laws.png", dpi=100)
