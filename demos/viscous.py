# %% [markdown]
# # How deep does a heel sink into memory foam, and when does it feel the floor?
#
# Foam creeps under a load, and locks where it cannot be compressed any further. Papers of 2025
# (doi:10.1515/dema-2025-0194 and doi:10.1515/gmj-2025-2071) prove that contact of such bodies with
# non-local friction has a solution for Kelvin and Voigt's law with a derivative of the order
# $0 < \alpha \le 1$ in time. Here it has numbers. With a relaxation time $\tau = 1$,
#
# $$\sigma = A\varepsilon(u) + \tau^\alpha A\varepsilon(D^\alpha u) + Z, \qquad
#   |\varepsilon(u)| \le M, \qquad
#   D^\alpha u(t) = \frac{1}{\Gamma(1-\alpha)} \int_0^t (t-s)^{-\alpha}\,\dot u(s)\,ds .$$
#
# $\alpha = 1$ is the rate $\dot u$ and a dashpot. A smaller $\alpha$ creeps over many decades of
# time, as foams and polymers do. If u is linear between the times $t_j$, the derivative is the sum
#
# $$D^\alpha u(t_n) = \sum_{j \le n} w_j (u_j - u_{j-1}), \qquad
#   w_j = \frac{(t_n - t_{j-1})^{1-\alpha} - (t_n - t_j)^{1-\alpha}}
#              {\Gamma(2-\alpha)\,(t_j - t_{j-1})},$$
#
# so that a step is a problem of elasticity with $(1 + w_n) A$ in $a$ and the past in $L$.
#
#     python demos/viscous.py 0.15 48        force over E times the thickness, cells along the foam

# %%
import sys
from math import gamma
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from scipy.special import erfcx

import contact_locking as cl

FORCE, CELLS = (float(word) for word in sys.argv[1:] or (0.15, 48))
comm, cells = MPI.COMM_WORLD, int(CELLS)


def creep(body: Any, order: float, times: Any, weight: float, contact: Any, limits: Any) -> Any:
    """The solutions at the times, for E = tau = 1 and nu = 0; the body stands on y = 0."""
    V = fem.functionspace(body, ("P", 1, (2,)))
    u, v, past = ufl.TrialFunction(V), ufl.TestFunction(V), fem.Function(V)
    rate = fem.Constant(body, 1.0)

    def elastic(u: Any, v: Any) -> Any:
        return ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) * ufl.dx

    a = elastic(u, v) + rate * elastic(u, v)
    L = rate * elastic(past, v) - fem.Constant(body, weight) * v[1] * ufl.dx
    bottom = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], 0))
    ground = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V)
    problem = cl.ContactProblem(a, L, [ground], limits, contact)
    solutions: list[Any] = [None]
    t, u_n = np.append(0.0, times), [np.zeros_like(past.x.array)]
    for n in range(1, len(t)):
        span = t[n] - t[: n + 1]
        powers = np.where(span > 0, span ** (1 - order), 0.0)
        weights = -np.diff(powers) / np.diff(t[: n + 1]) / gamma(2 - order)
        steps = np.diff(u_n, axis=0)
        rate.value = weights[-1]
        past.x.array[:] = u_n[-1] - weights[:-1] @ steps / weights[-1] if n > 1 else u_n[-1]
        solution = problem.solve(after=solutions[-1], certificate=False)
        assert solution.converged, solution.summary["reason"]
        u_n.append(solution.displacement.x.array.copy())
        solutions.append(solution)
    problem.close()
    return solutions[1:]


# %% [markdown]
# ## A column that sinks under its weight, as a check
#
# At the height y the weight w of the part above gives the stress $w\,(1-y)$, and the strain is
# $\min(M,\ w\,(1-y)\,(1-r(t)))$ with $r = e^{-t}$ for $\alpha = 1$ and
# $r = e^t\,\mathrm{erfc}\sqrt t$ for $\alpha = \frac{1}{2}$: the locked zone climbs from the
# ground.

# %%
weight, M, crossed = 0.2, 0.1, mesh.DiagonalType.crossed
column = mesh.create_rectangle(comm, [[0, 0], [0.1, 1]], [1, cells], diagonal=crossed)
times, y = np.geomspace(1e-3, 1e2, 60), (np.arange(1000) + 0.5) / 1000
for order, relaxed in ((1.0, np.exp(-times)), (0.5, erfcx(np.sqrt(times)))):
    exact = np.minimum(M, weight * np.outer(1 - relaxed, 1 - y)).mean(axis=1)
    steps = creep(column, order, times, weight, [], [cl.StrainBall(M)])
    sunk = np.array([-step.displacement.x.array.min() for step in steps])
    print(
        f"alpha = {order}: sinks by {sunk[-1]:.5f} (exact {exact[-1]:.5f}), largest difference "
        f"at a time {np.abs(sunk - exact).max() / exact[-1]:.1%}"
    )
    assert np.abs(sunk - exact).max() < 0.02 * exact[-1] and abs(sunk[-1] / exact[-1] - 1) < 2e-3

# %% [markdown]
# ## The heel
#
# A round heel is pushed by a force into a layer that is glued to the floor. Without a limit and
# with a small order it sinks on for decades. With the limit a locked column grows below it. Sinking
# ends where that reaches the floor, long before creep would end, and for both orders alike: time
# and $\alpha$ decide when, and $M$ decides where.

# %%
size = [cells, cells // 4]
foam = mesh.create_rectangle(comm, [[-2, 0], [2, 1]], size, diagonal=crossed)
top = mesh.locate_entities_boundary(foam, 1, lambda x: np.isclose(x[1], 1) & (abs(x[0]) < 1.2))
heel = cl.Foundation(cl.Sphere((0, 1.8), 0.8), force=(0, -FORCE))
contact = cl.Contact(top, heel, cl.Coulomb(0.5, cl.Convolution(0.1)))
times = np.geomspace(1e-2, 1e2, 25)
curves = {}
for order in (1.0, 0.5):
    for limits in ([], [cl.StrainBall(M)]):
        steps = creep(foam, order, times, 0.0, [contact], limits)
        curves[order, bool(limits)] = [
            step.summary["contacts"][0]["tool"]["travel"] for step in steps
        ]
assert curves[1.0, True][-1] < 0.8 * curves[1.0, False][-1]  # the foam carries the heel

# %%
layout: Any = [[0, 8, 16, 24], ["depth"] * 4]
figure, axes = plt.subplot_mosaic(layout, figsize=(8, 5), layout="constrained")
x = steps[0].displacement.function_space.tabulate_dof_coordinates()[:, :2]
cell = steps[0].displacement.function_space.dofmap.list
for number in layout[0]:
    step, ax = steps[number], axes[number]
    moved = x + step.displacement.x.array.reshape(-1, 2)
    strain = step.strain_norm.x.array.reshape(len(cell), -1).max(axis=1)
    image = ax.tripcolor(*moved.T, cell, facecolors=strain / M, cmap="magma_r", vmin=0, vmax=1)
    ax.add_patch(plt.Circle((0, 1.8 - curves[0.5, True][number]), 0.8, color="0.6"))
    ax.set(aspect="equal", xlim=(-1.3, 1.3), ylim=(-0.05, 1.5), title=f"t = {times[number]:.3g} τ")
    ax.axis("off")
figure.colorbar(image, ax=axes[24], label=f"|ε| / {M}")
for (order, locks), depth in curves.items():
    name = f"α = {order:g}, " + (f"|ε| ≤ {M}" if locks else "no limit")
    line, colour = "-" if locks else "--", "C0" if order == 1 else "C1"
    axes["depth"].semilogx(times, depth, line, color=colour, label=name)
axes["depth"].set(xlabel="t / τ", ylabel="depth / thickness")
axes["depth"].invert_yaxis()
axes["depth"].legend(frameon=False)
Path("results").mkdir(exist_ok=True)
figure.savefig("results/viscous.png", dpi=110)
