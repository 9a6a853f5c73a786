# %% [markdown]
# # How do forty grains that lock carry a piston?
#
# Forty discs lie in a box, and a piston presses them. Each disc is an elastic body with a limit of
# the strain, and touches its neighbours with friction. The parts of all discs have one name, which
# is on both sides of the contact:
#
#     contact:
#       - {on: grains, against: grains}
#
# Each facet then faces the nearest other body. The walls and the piston are rigid foundations.

# %%
import sys
from itertools import pairwise
from pathlib import Path

from matplotlib import pyplot as plt
from mpi4py import MPI

from contact_locking import load, solve_steps, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
depths, forces, locked = [0.0], [0.0], [0.0]
for solution in solve_steps(parameters, comm):
    assert solution.converged, solution.summary["reason"]
    *_, piston = solution.summary["contacts"]
    depths.append(0.1 * solution.time)
    forces.append(-float(piston["contact_force"][1]))
    locked.append(float(solution.summary["locked_fraction"]))
write(solution, parameters.output.directory)

# %% [markdown]
# ## The force over the depth
#
# At first few of the grains touch. Then chains of grains carry the force, and in the end the most
# loaded grains lock: the packing stiffens. The contacts are shorter than the facets, and so the
# force depends on the mesh: at h = 0.3 it is a quarter less.

# %%
if comm.rank == 0:
    for depth, force, share in zip(depths, forces, locked, strict=True):
        print(f"depth {depth:.2f}: force {force:.4f}, {share:.1%} of the grains at the limit")
    figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
    axes.plot(depths, forces, marker=".", color="#0072b2")
    axes.set(xlabel="depth of the piston", ylabel="force")
increments = [after - before for before, after in pairwise(forces) if before > 0.0]
assert increments[-1] > 1.2 * increments[0]
assert locked[-1] > 0.0

# %% [markdown]
# ## Action and reaction
#
# The forces between the grains are opposite: their sum over both sides is zero to rounding. The
# picture `picture.png` in the folder of results shows the chains that carry the force.
