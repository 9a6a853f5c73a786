# %% [markdown]
# # How much work does friction dissipate in a cycle?
#
# A block is pressed onto a cylinder and moved to and fro. Friction holds the middle of the contact
# and lets its edges slip. The force depends on the way and not only on the place: the force over
# the displacement is a loop, and its area is the work that friction dissipates in a cycle. The
# static problem has no such loop, because it knows no past.
#
# In the study file, `t` stands in the displacement, and `steps` has the times:
#
#     loads:
#       displacements:
#         - {on: top, value: ["0.014*sin(2*pi*max(t - 0.1, 0))", "-0.03*min(t/0.1, 1)"]}
#     steps: {to: 2.1, count: 42}
#
# Each step is one problem of the kind that this program solves anyway. The slip of the earlier
# steps shifts the friction cones.

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
zones = []
for solution in solve_steps(parameters, comm):
    assert solution.converged, solution.summary["reason"]
    points = solution.contact_points
    if points is not None:
        zones.append(points.state)
write(solution, parameters.output.directory)

# %% [markdown]
# ## The loop
#
# The tractions that the pressing has left wear off in the first half of a cycle; then the loop
# closes. The elastic body takes most of the displacement. The loop shows what is left without the
# displacement of a block that sticks everywhere, whose stiffness is that of the first step after
# the motion turns.

# %%
history = solution.history
time, friction = history.column("t"), history.column("friction_force_x")
shift = 0.014 * np.sin(2 * np.pi * np.maximum(time - 0.1, 0))
peaks = [int(np.argmin(abs(time - t))) for t in (0.35, 1.35)]
most = abs(friction[peaks[0]])
assert abs(friction[peaks[1]] - friction[peaks[0]]) < 0.05 * most
turn = peaks[0]
stiffness = (friction[turn + 1] - friction[turn]) / (shift[turn] - shift[turn + 1])
if comm.rank == 0:
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    left.plot(1e3 * (shift + friction / stiffness), -friction, marker=".", color="#0072b2")
    left.set(xlabel="1000 × displacement beyond that of a block that sticks", ylabel="shear force")
    right.plot(time, history.column("dissipated_total"), marker=".", color="#d55e00")
    right.set(xlabel="t", ylabel="work dissipated by friction")
    figure.savefig(Path(parameters.output.directory) / "loop.png", dpi=110)

# %% [markdown]
# ## Where the block sticks
#
# When the motion turns round, the whole contact sticks at first; then slip begins again at the
# edges. The states of the contact points tell how many slip in each step.

# %%
if comm.rank == 0:
    slips = [int(np.sum(states == 2)) for states in zones]
    print("slipping points in each step:", slips)

# %% [markdown]
# ## The energy balance
#
# The work of the loads is stored, dissipated by friction, or lost by the method: an implicit Euler
# step loses energy and never creates energy. The loss is of the order of the square of the step,
# and each step checks the bounds of the loss as one more criterion.

# %%
totals = solution.summary["steps"]
rest = totals["work"] - totals["stored"] - totals["dissipated"] - totals["numerical"]
assert abs(rest) < 1e-9 * totals["work"]
assert (history.column("numerical") >= 0).all()
if comm.rank == 0:
    print(
        f"work {totals['work']:.3e} = stored {totals['stored']:.3e} + dissipated "
        f"{totals['dissipated']:.3e} + numerical {totals['numerical']:.3e}"
    )
    print(f"{totals['tangents'] / totals['solved']:.1f} tangents in a step")
