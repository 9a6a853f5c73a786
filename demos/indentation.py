# %% [markdown]
# # How hard must one press a ball into a layer that locks?
#
# A rigid ball is pressed into a layer. Everything is symmetric about the axis of the ball, so that
# the half section of the layer is enough:
#
#     mesh: {builder: block, size: [1.0, 0.8], h: 0.02, axisymmetric: true}
#
# x is the radius r and y the height z. A point that moves outwards by $u_r$ stretches its circle
# by the hoop strain $u_r/r$, which takes part in the limit $|\varepsilon(u)| \le M$. All integrals
# have the factor $2\pi r$: forces are those of the whole ball.
#
# The mesh has some 5000 unknowns. In space, cells of the same size would have about a million.

# %%
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib import pyplot as plt
from matplotlib.collections import PolyCollection
from mpi4py import MPI

from contact_locking import StudySolution, load, solve_steps, write

FloatArray = npt.NDArray[np.float64]

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
RADIUS, DEPTH, CENTRE = 0.5, 0.05, 1.3

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters


def pressed(*changes: str) -> StudySolution:
    """The last step, whose history has all steps."""
    for solution in solve_steps(load(FILE, [*CHANGES, *changes]).parameters, comm):
        assert solution.converged, solution.summary["reason"]
    return solution


locking, elastic = pressed(), pressed("material.locking_limit=.inf")
write(locking, parameters.output.directory)

# %% [markdown]
# ## The force over the depth
#
# Hertz's force on an elastic half space is $F = \frac43 E^* \sqrt{R}\, d^{3/2}$ at the depth d. The
# layer of finite height is some 20 % stiffer. Where the strain below the ball reaches its limit,
# the material yields no further: at the end the force is almost twice that of the elastic layer.

# %%
depth = DEPTH * locking.history.column("t")
modulus = 1.0 / (1.0 - 0.3**2)
hertz = 4.0 / 3.0 * modulus * np.sqrt(RADIUS) * depth**1.5
forces = {
    "elastic": -elastic.history.column("contact_force_y"),
    "locking": -locking.history.column("contact_force_y"),
}
if comm.rank == 0:
    print("depth    Hertz    elastic  locking  locked")
    locked = locking.history.column("locked_fraction")
    for row in zip(depth, hertz, *forces.values(), locked, strict=True):
        print("{:.3f}  {:.5f}  {:.5f}  {:.5f}  {:5.2f} %".format(*row[:-1], 100 * row[-1]))
assert (forces["locking"] >= forces["elastic"] * (1 - 1e-6)).all()
assert forces["locking"][-1] > 1.4 * forces["elastic"][-1]
assert 1.05 * hertz[-1] < forces["elastic"][-1] < 1.6 * hertz[-1]

# %% [markdown]
# ## Both layers in one picture
#
# The left half is the elastic layer, the right half the layer that locks. The material below the
# ball becomes a stiff core: it carries the ball on a smaller contact with a higher pressure, and
# hands the deformation on to its surroundings.


# %%
def section(solution: StudySolution) -> tuple[FloatArray, FloatArray] | None:
    """Deformed triangles (c, 3, 2), and |eps| in each (c,), on rank 0."""
    u, strain = solution.displacement, solution.strain_norm
    owned = u.function_space.mesh.topology.index_map(2).size_local
    x = u.function_space.tabulate_dof_coordinates()[:, :2] + u.x.array.reshape(-1, 2)
    triangles = x[u.function_space.dofmap.list[:owned]]
    values = strain.x.array[strain.function_space.dofmap.list[:owned, 0]]
    parts = comm.gather((triangles, values))
    if parts is None:
        return None
    corners, norms = (np.concatenate(part) for part in zip(*parts, strict=True))
    return corners, norms


halves = {"elastic": section(elastic), "locking": section(locking)}
profiles = {"elastic": elastic.contact_points, "locking": locking.contact_points}
if comm.rank == 0:
    figure, places = plt.subplot_mosaic(
        [["body", "body"], ["curve", "profile"]], figsize=(8.6, 8.2), layout="constrained"
    )
    body, curve, profile = (places[name] for name in ("body", "curve", "profile"))
    for side, half in zip((-1.0, 1.0), halves.values(), strict=True):
        assert half is not None
        cells = PolyCollection(
            list(half[0] * [side, 1.0]), array=half[1], cmap="magma_r", edgecolors="face"
        )
        cells.set_clim(0.0, 0.2)
        body.add_collection(cells)
    figure.colorbar(cells, ax=body, label=r"$|\varepsilon(u)|$", extend="max")
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    body.fill(RADIUS * np.cos(turn), CENTRE - DEPTH + RADIUS * np.sin(turn), color="0.8", ec="0.4")
    body.axvline(0.0, color="0.4", linestyle=(0, (6, 3, 1, 3)), linewidth=0.8)
    for x, name in ((-0.52, "no limit"), (0.52, r"$|\varepsilon| \leq 0.08$")):
        body.text(x, 0.36, name, ha="center")
    body.set(xlim=(-0.75, 0.75), ylim=(0.3, 1.0), aspect="equal", xlabel="r", ylabel="z")
    colours = {"elastic": "#0072b2", "locking": "#d55e00"}
    curve.plot(depth, hertz, color="0.5", linestyle="--", label="Hertz, half space")
    for name, colour in colours.items():
        curve.plot(depth, forces[name], marker=".", color=colour, label=name)
        points = profiles[name]
        assert points is not None
        order = np.argsort(points.x[:, 0])
        profile.plot(points.x[order, 0], points.pressure[order], marker=".", color=colour)
    curve.set(xlabel="depth of the ball", ylabel="force on the whole ball")
    curve.legend(frameon=False)
    profile.set(xlabel="r", ylabel="contact pressure", xlim=(0.0, 0.3))
    figure.savefig(Path(parameters.output.directory) / "indentation.png", dpi=110)
