# %% [markdown]
# # How hard does a hoop hit the floor if its strain is limited?
#
# An elastic hoop thrown onto a floor with friction flattens, swings and flies on. One that locks
# at $|\varepsilon(u)| \le M$ can flatten less. `ContactProblem` knows no time, but its forms may:
# the mass goes into $a$ and the past into $L$. A step $\tau$ from $(u_0, v_0)$ to $(u_1, v_1)$ is
#
# $$\tfrac{2\rho}{\tau^2}\,(u_1 - u_0 - \tau v_0) + \theta A u_1 + (1 - \theta) A u_0
#   = \text{contact, friction and locking forces at } u_1, \qquad
#   v_1 = \tfrac{2}{\tau}(u_1 - u_0) - v_0 .$$
#
# **Energy is never gained.** Test with $u_1 - u_0 = \frac\tau2(v_1 + v_0)$: for
# $\theta \ge \frac{1}{2}$ the left side is at least the gain of energy. The right side is not
# positive: $u_0$ lay above the floor and within the limit, and friction acts against the slip.
#
# Mass on the contact makes its force jump from step to step. So a thin skin has none, as in the
# mass redistribution of Khenous, Laborde and Renard, and $\theta = 1$ there.
#
#     python demos/impact.py 0.04 48        speed over that of sound, cells around the hoop

# %%
import sys
from pathlib import Path
from typing import Any

import basix.ufl
import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem, mesh
from matplotlib.animation import ArtistAnimation
from matplotlib.tri import Triangulation
from mpi4py import MPI

import contact_locking as cl

SPEED, CELLS = (float(word) for word in sys.argv[1:] or (0.04, 48))
comm, cells = MPI.COMM_WORLD, int(CELLS)


def throw(body: Any, light: Any, velocity: Any, times: Any, floor: Any, limits: Any = ()) -> Any:
    """Arrays over the times, for E = rho = 1 and nu = 0: the speed of sound is 1."""
    tau = float(times[0])
    V, P0 = fem.functionspace(body, ("P", 2, (2,))), fem.functionspace(body, ("DG", 0))
    u, v, u0, v0 = ufl.TrialFunction(V), ufl.TestFunction(V), fem.Function(V), fem.Function(V)
    v0.interpolate(lambda x: np.outer(velocity, np.ones(x.shape[1])))
    rho, theta = fem.Function(P0), fem.Function(P0)
    total = fem.form(1.0 * rho * ufl.dx)
    rho.x.array[:], theta.x.array[:] = 1.0, 0.5
    area = fem.assemble_scalar(total)
    rho.x.array[light], theta.x.array[light] = 0.0, 1.0
    rho.x.array[:] *= area / fem.assemble_scalar(total)

    def elastic(share: Any, u: Any, v: Any) -> Any:
        return share * ufl.inner(ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))) * ufl.dx

    mass = 2.0 / tau**2 * rho
    a = mass * ufl.inner(u, v) * ufl.dx + elastic(theta, u, v)
    L = mass * ufl.inner(u0 + tau * v0, v) * ufl.dx - elastic(1.0 - theta, u0, v)
    energy = fem.form(0.5 * rho * ufl.inner(v0, v0) * ufl.dx + elastic(0.5, u0, u0))
    momentum = [fem.form(rho * v0[i] * ufl.dx) for i in range(2)]
    problem, solution, rows = cl.ContactProblem(a, L, [], limits, [floor]), None, []
    for _ in times:
        solution = problem.solve(after=solution, certificate=False)
        assert solution.converged, solution.summary["reason"]
        u1, summary = solution.displacement.x.array, solution.summary
        v0.x.array[:], u0.x.array[:] = 2.0 * (u1 - u0.x.array) / tau - v0.x.array, u1
        force = np.add(summary["contact_force"], summary["friction_force"])
        strain = solution.strain_norm.x.array.reshape(len(rho.x.array), -1).max(axis=1)
        moving = [fem.assemble_scalar(form) for form in momentum]
        rows.append((fem.assemble_scalar(energy), moving, force, u1.reshape(-1, 2).copy(), strain))
    names = ("energy", "p", "force", "u", "strain")
    run = dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))
    change = np.diff(run["p"], axis=0, prepend=[area * np.array(velocity)])
    assert np.allclose(change, tau * run["force"], atol=1e-6 * area * SPEED)
    start = 0.5 * area * np.dot(velocity, velocity)
    assert np.diff(run["energy"], prepend=start).max() <= 1e-6 * start
    grid = Triangulation(*V.tabulate_dof_coordinates().T[:2], V.dofmap.list[:, :3])
    return {**run, "t": times, "grid": grid}


def draw(ax: Any, run: Any, step: int, shift: float = 0.0) -> Any:
    (x, y), strain, grid = run["u"][step].T, run["strain"][step] / M, run["grid"]
    faces = {"facecolors": strain, "cmap": "magma_r", "clim": (0, 1)}
    return ax.tripcolor(grid.x + x + shift, grid.y + y, grid.triangles, **faces)


# %% [markdown]
# ## A bar on a wall, as a check
#
# A bar of the length $L = 1$ that arrives with the speed $v$ is pressed by $E v / c$ until its wave
# has been at the far end and is back, at $t = 2L/c$. Then it leaves with the speed $v$.

# %%
width, times = 0.05, np.arange(1.0, 1.4 * cells) * 2 / cells
bar = mesh.create_rectangle(comm, [[0, 0], [width, 1]], [1, cells])
end = mesh.locate_entities_boundary(bar, 1, lambda x: np.isclose(x[1], 0))
tip = mesh.locate_entities(bar, 2, lambda x: x[1] < 1.01 / cells)
first = throw(bar, tip, (0, -SPEED), times, cl.Contact(end, cl.HalfSpace((0, 0), (0, 1))))
stress, rebound = first["force"][:, 1] / (width * SPEED), first["p"][-1, 1] / (width * SPEED)
plateau, last = stress[cells // 4 : 3 * cells // 4], first["t"][stress > 1e-6][-1]
print(f"pressure {plateau.mean():.3f} E v/c until t = {last:.3f} L/c, rebound {rebound:.3f} v")
assert np.allclose(plateau, 1.0, atol=0.08)
assert abs(last - 2.0) < 3 * times[0] and 0.9 < rebound <= 1.0

# %% [markdown]
# ## The hoop
#
# Locking cells stop at once, which costs energy, as a hit of rigid bodies does. The force is up to
# twice as large, and the contact shorter. (Frames are drawn apart; impact.gif shows the motion.)

# %%
radii, angle = np.array([0.8, 0.89, 0.98, 1.0]), 2 * np.pi * np.arange(cells) / cells
nodes = np.stack([np.outer(radii, np.sin(angle)), -np.outer(radii, np.cos(angle))], axis=-1)
layer, i = np.divmod(np.arange(3 * cells), cells)
a, b = layer * cells + i, layer * cells + (i + 1) % cells
ring = np.stack([a, b, b + cells, a, b + cells, a + cells], axis=1).reshape(-1, 3)
element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
body = mesh.create_mesh(comm, cells=ring, x=nodes.reshape(-1, 2), e=element)
skin = mesh.locate_entities(body, 2, lambda x: np.hypot(*x[:2]) > 0.97)
sole = mesh.locate_entities_boundary(body, 1, lambda x: (np.hypot(*x[:2]) > 0.97) & (x[1] < -0.4))
floor = cl.Contact(sole, cl.HalfSpace((0, -1.04), (0, 1)), cl.Coulomb(0.4, cl.Convolution(0.1)))
M, times = SPEED / 2, np.arange(1, 3 * cells) * 9.6 / cells
free = throw(body, skin, (SPEED, -SPEED), times, floor)
locking = throw(body, skin, (SPEED, -SPEED), times, floor, [cl.StrainBall(M)])
runs = {"no limit": free, f"|ε| ≤ {M:g}": locking}
assert locking["strain"].max() <= M * (1 + 1e-6) < free["strain"].max()

layout = [["no"] * 2, ["limit"] * 2, ["force", "energy"]]
figure, axes = plt.subplot_mosaic(layout, figsize=(8, 5.8), layout="constrained")
film, scenes = plt.subplots(2, figsize=(4, 5), layout="constrained")
for ax, scene, (name, run) in zip((axes["no"], axes["limit"]), scenes, runs.items(), strict=True):
    for place, right in ((ax, 13.2), (scene, 3.2)):
        place.axhspan(-1.3, -1.04, color="0.8")
        place.set(aspect="equal", xlim=(-1.2, right), ylim=(-1.3, 1.6), title=name)
        place.axis("off")
    for frame, step in enumerate(np.array([0, 0.1, 0.25, 0.38, 0.7, 1]) * (len(times) - 1)):
        image, t = draw(ax, run, int(step), 2.15 * frame), times[int(step)]
        ax.text(2.15 * frame + SPEED * t, 0, f"t = {t:.0f}", ha="center", fontsize=9)
    axes["force"].plot(run["t"], run["force"][:, 1], label=name)
    axes["energy"].plot(run["t"], run["energy"] / run["energy"][0], label=name)
figure.colorbar(image, ax=[axes["no"], axes["limit"]], label=f"|ε| / {M:g}")
axes["force"].set(xlabel="t c / R", ylabel="force of the floor / (E R)")
axes["energy"].set(xlabel="t c / R", ylabel="energy left", ylim=(0, 1.05))
axes["energy"].legend(frameon=False)
Path("results").mkdir(exist_ok=True)
figure.savefig("results/impact.png", dpi=110)
pairs = list(zip(scenes, runs.values(), strict=True))
shots = [[draw(*pair, step) for pair in pairs] for step in range(0, len(times), 2)]
ArtistAnimation(film, shots).save("results/impact.gif", "pillow", fps=12, dpi=72)
