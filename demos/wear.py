# %% [markdown]
# # What does a flat punch wear to, and what does wear leave of the peaks of pressure?
#
# A flat punch presses most at its edges. It slides to and fro across the plane of the drawing and
# wears by Archard's law: on a way $s$ it loses the depth $h$ by $dh/ds = k\,p$. So the edges go
# first, until the punch presses everywhere alike; from then on it wears and keeps its shape.
#
# The worn depth opens the gap. For the pressure at the end of a step $\Delta s$ this reads
#
# $$u_\nu - g - h_0 \le k\,\Delta s\,p, \quad \text{equal where } p > 0, \qquad\text{or}\qquad
#   p = \tfrac{1}{\epsilon}\,[u_\nu - g - h_0]^+ \quad\text{with}\quad \epsilon = k\,\Delta s :$$
#
# the law of contact with a finite `compliance`. So a step of wear is one solve, and stable for any
# length, while explicit steps are limited by the stiffness of a cell. The worn punch is an object
# with a gap and a normal, which a force pushes.
#
#     python demos/wear.py 0.1 80        force over E a, cells along the body

# %%
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from dolfinx import fem, mesh
from mpi4py import MPI

import contact_locking as cl

FORCE, CELLS = (float(word) for word in sys.argv[1:] or (0.1, 80))
comm, cells, poisson = MPI.COMM_WORLD, int(CELLS), 0.3


class Punch:
    """Its face is at the height h(x), by values at nodes."""

    def __init__(self) -> None:
        self.x, self.h = np.array([-1.0, 1.0]), np.zeros(2)

    def gap(self, x: Any) -> Any:
        return np.interp(x[0], self.x, self.h) - x[1]

    def contact_normal(self, x: Any) -> Any:
        return np.stack([np.zeros_like(x[0]), np.ones_like(x[0])])


# %% [markdown]
# In units of E, k and half the width of the punch, $|x| \le a = 1$, the body is a wide and deep
# block. Its mesh is that of a rectangle, whose nodes are moved outwards.

# %%
size, crossed = [cells, cells // 4], mesh.DiagonalType.crossed
body = mesh.create_rectangle(comm, [[-1, -0.5], [1, 0]], size, diagonal=crossed)
nodes = body.geometry.x
far, deep = np.abs(nodes[:, 0]), -nodes[:, 1]
stretched = np.where(far < 0.5, 2 * far, 1 + (np.exp(6 * (far - 0.5)) - 1) / 3)
nodes[:, 0], nodes[:, 1] = np.sign(nodes[:, 0]) * stretched, (1 - np.exp(6 * deep)) / 3
V = fem.functionspace(body, ("P", 1, (2,)))
face = mesh.locate_entities_boundary(body, 1, lambda x: (x[1] > -1e-9) & (abs(x[0]) < 1 + 1e-9))
bottom = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], nodes[:, 1].min()))
held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V)
WAYS = np.append(0.0, np.geomspace(0.01, 10, 24))


def wear(limits: Any) -> tuple[Any, Any, Any]:
    """The nodes (k,), the depths (n, k) after the ways, and the solutions."""
    punch, depths, solutions = Punch(), [], []
    for step in np.diff(WAYS, prepend=0.0):
        contact = cl.Contact(face, cl.Foundation(punch, force=(0, -FORCE)))
        elasticity = cl.Elasticity(young=1.0, poisson=poisson)
        problem = cl.ContactProblem(
            elasticity, None, [held], limits, [contact], space=V, compliance=step
        )
        solution: Any = problem.solve(certificate=False)
        problem.close()
        assert solution.converged, solution.summary["reason"]
        x, p = solution.contact_points.x[:, 0], solution.contact_points.pressure
        punch.x, punch.h = x, np.interp(x, punch.x, punch.h) + step * p
        depths.append(punch.h)
        solutions.append(solution)
    assert np.isclose(np.trapezoid(punch.h, x), FORCE * WAYS[-1])  # the volume of Archard
    return x, np.array(depths), solutions


# %% [markdown]
# ## A half plane, as a check
#
# The closed forms are those of a half plane: at first $p = F / (\pi\sqrt{a^2 - x^2})$, in the end
# $p = F/2a$, and under this pressure the surface, hence the worn punch, has the shape
#
# $$h(x) - h(0) = \frac{1 - \nu^2}{\pi E}\,F\,
#   \bigl[(1+\xi)\ln(1+\xi) + (1-\xi)\ln(1-\xi)\bigr], \qquad \xi = x/a .$$

# %%
x, depths, solutions = wear([])
pressures = [solution.contact_points.pressure for solution in solutions]
inner = np.abs(x) < 0.6
first = FORCE / np.pi / np.sqrt(1 - x[inner] ** 2)
xi = np.clip(x, -1 + 1e-12, 1 - 1e-12)
logs = (1 + xi) * np.log(1 + xi) + (1 - xi) * np.log(1 - xi)
worn = (1 - poisson**2) / np.pi * FORCE * logs
shape = depths[-1] - depths[-1].min()
print(f"flat: the pressure differs by {np.abs(pressures[0][inner] / first - 1).max():.1%}")
print(f"worn: by {np.abs(pressures[-1] * 2 / FORCE - 1).max():.2%}, ", end="")
print(f"and the shape by {np.abs(shape - worn).max() / worn.max():.1%}")
assert np.allclose(pressures[0][inner], first, rtol=0.06)
assert np.allclose(pressures[-1], FORCE / 2, rtol=0.01)
assert np.abs(shape - worn).max() < 0.05 * worn.max()

# %% [markdown]
# ## The same punch on a body that locks
#
# The limit makes the first peaks higher still. Wear removes them all the same: its law decides that
# the pressure is uniform in the end, and the body decides the shape.

# %%
M = 0.03
x, locking_depths, locking = wear([cl.StrainBall(M)])
assert np.allclose(locking[-1].contact_points.pressure, FORCE / 2, rtol=0.01)

# %%
layout: Any = [[0, 12, 24], ["pressure", "pressure", "depth"]]
figure, axes = plt.subplot_mosaic(layout, figsize=(8, 5.4), layout="constrained")
dofs, cell = V.tabulate_dof_coordinates()[:, :2], V.dofmap.list
for number in layout[0]:
    ax, step = axes[number], locking[number]
    moved = dofs + step.displacement.x.array.reshape(-1, 2)
    strain = step.strain_norm.x.array.reshape(len(cell), -1).max(axis=1) / M
    image = ax.tripcolor(*moved.T, cell, facecolors=strain, cmap="magma_r", vmin=0, vmax=1)
    travel = step.summary["contacts"][0]["tool"]["travel"]
    ax.fill_between(x, locking_depths[number] - travel, 1.3 - travel, color="0.6")
    ax.set(aspect="equal", xlim=(-2.2, 2.2), ylim=(-2, 1.3), title=f"k E s/a = {WAYS[number]:.2g}")
    ax.axis("off")
figure.colorbar(image, ax=axes[24], label=f"|ε| / {M}")
for number in (0, 4, 8, 12, 16, 24):
    colour = plt.cm.viridis(0.9 - number / 28)
    for run, line in ((solutions, "-"), (locking, ":")):
        p = run[number].contact_points.pressure / (FORCE / 2)
        axes["pressure"].plot(x, p, line, color=colour)
    axes["pressure"].plot([], [], color=colour, label=f"{WAYS[number]:.2g}")
axes["pressure"].set(ylim=(0, 4), xlabel="x / a", ylabel="pressure 2a p / F")
axes["pressure"].legend(frameon=False, title="k E s/a", ncols=2, loc="upper center")
axes["depth"].plot(x, shape, label="elastic")
axes["depth"].plot(x, worn, "k--", label="closed form")
axes["depth"].plot(x, locking_depths[-1] - locking_depths[-1].min(), ":", label=f"|ε| ≤ {M}")
axes["depth"].set(xlabel="x / a", ylabel="worn shape h / a")
axes["depth"].legend(frameon=False, loc="upper center")
Path("results").mkdir(exist_ok=True)
figure.savefig("results/wear.png", dpi=90)
