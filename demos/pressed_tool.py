# %% [markdown]
# # How hard do packed grains resist a pestle from an STL file?
#
# A pestle is pressed into a box of packed grains and lifted again. Grains that touch each other
# cannot be packed closer, but they may come apart: the volume shrinks by 2 % at most and may grow.
# This is the half space tr ε ≥ −0.02 of strains.
#
# The tool is a surface of triangles, and it moves as a rigid body:
#
#     contact:
#       on: top
#       foundation:
#         surface: {file: pestle.stl, scale: 1.6, shift: [1.0, 0.0, 0.8]}
#         motion: [0, 0, "-0.15*(1 - abs(1 - t))"]
#
# Gap and normal are those of the tool at its place in each step, and friction acts on the slip
# relative to the tool. Two planes of symmetry leave a quarter of the box, and show its inside.

# %%
import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from mpi4py import MPI

from contact_locking import load, solve_steps, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
folder = Path(parameters.output.directory)
deepest = float("nan")
for solution in solve_steps(parameters, comm):
    assert solution.converged, solution.summary["reason"]
    if abs(solution.time - 1.0) < 1e-9:
        deepest = solution.summary["certificate"]["errors"]["mesh"]["relative"]
        # The picture with the pestle at its deepest place.
        write(solution, folder / "deepest")
write(solution, folder)

# %% [markdown]
# ## Quadratic elements
#
# Grains that are packed keep their volume. A linear element that keeps its volume can hardly change
# its shape, so that linear elements make the packed grains too stiff. The contact force at the
# deepest place, and the estimate of the relative error of the mesh in the energy norm:
#
# | elements | unknowns | contact force, of the quarter | estimate |
# | --- | --- | --- | --- |
# | linear, h = 0.14 | 1413 | 0.0312 | 32 % |
# | linear, h = 0.07 | 7560 | 0.0282 | 21 % |
# | quadratic, h = 0.14 | 8793 | 0.0252 | 9.6 % |
# | quadratic, h = 0.1 | 19911 | 0.0246 | 7.7 % |
#
# The surface of the tool counts as well. With a pestle of 16 sides, whose corners are on the same
# surface of revolution, the force is a tenth smaller. Its edges raise the estimate from 9.6 % to
# 14 %, and to 21 % at smaller depths.

# %%
if comm.rank == 0:
    print(f"estimated error of the mesh at the deepest place: {deepest:.1%}")

# %% [markdown]
# ## Force and depth
#
# The deeper the pestle, the more grains are packed as closely as they can be, and the stiffer the
# box. On the way back friction pulls the other way: the force is smaller at the same depth, and the
# loop is the work that friction has dissipated. The packing itself loses nothing, as locking is
# reversible.

# %%
history = solution.history
depth = 0.15 * (1 - abs(1 - history.column("t")))
# The force on the whole pestle, of which the body has a quarter.
force = -4 * (history.column("contact_force_z") + history.column("friction_force_z"))
packed = history.column("locked_fraction")
down = int(np.argmax(depth))
assert np.all(np.diff(force[: down + 1]) > 0.0) and np.all(np.diff(packed[: down + 1]) >= 0.0)
if comm.rank == 0:
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    left.plot([0, *depth], [0, *force], marker=".", color="#0072b2")
    left.set(xlabel="depth", ylabel="force on the pestle")
    right.plot([0, *depth], [0, *(100 * packed)], marker=".", color="#d55e00")
    right.set(xlabel="depth", ylabel="packed as closely as possible [%]")
    figure.savefig(folder / "force.png", dpi=110)

# %% [markdown]
# ## The work of the tool
#
# The pestle does all the work, as the walls do not move. What is not stored is dissipated by
# friction, or lost by the method, and every step proves that it creates no energy.

# %%
totals = solution.summary["steps"]
assert (history.column("numerical") >= -1e-12).all()
if comm.rank == 0:
    print(
        f"work {totals['work']:.3e} = stored {totals['stored']:.3e} + dissipated "
        f"{totals['dissipated']:.3e} + numerical {totals['numerical']:.3e}"
    )
