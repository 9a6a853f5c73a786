# %% [markdown]
# # Can two soft fingers carry a soft ball?
#
# The roots of two fingers move inwards, and the fingers bend around a softer ball. Then the weight
# of the ball comes, which friction alone bears. All three bodies have a limit of the strain. The
# ball is side 1, and both pads are side 2:
#
#     contact: {on: rim, against: [left_pad, right_pad]}

# %%
import math
import sys
from pathlib import Path

from matplotlib import pyplot as plt
from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD
held = solve(load(FILE, CHANGES).parameters, comm)
assert held.converged, held.summary["reason"]
write(held, held.parameters.output.directory)

# %% [markdown]
# ## Friction bears the weight
#
# The forces between fingers and ball are opposite, and so their sum over both sides is zero to
# rounding. A part of each contact slips, and the rest sticks.

# %%
history, summary = held.history, held.summary
time, lifted = history.column("t"), history.column("friction_force_y")
normal = history.column("contact_force_y")
if comm.rank == 0:
    print(f"the fingers bear {lifted[-1] + normal[-1]:.4f} of the ball")
    print(f"{summary['locked_fraction']:.1%} of the bodies are at their limit")
    figure, axes = plt.subplots(figsize=(5, 3.6), layout="constrained")
    axes.plot(time, lifted + normal, marker=".", color="#0072b2")
    axes.set(xlabel="t", ylabel="force of the fingers on the ball, upwards")
# 0.0012 times the area of the disc.
assert abs(lifted[-1] + normal[-1] - 0.0012 * math.pi) < 0.02 * 0.0012 * math.pi
assert max(abs(x) for x in summary["certificate"]["resultants"]["contact"]) < 1e-12

# %% [markdown]
# The picture `picture.png` in the folder of results shows the bent fingers, which lock at their
# roots, and the ball, which locks where it is gripped.
