# %% [markdown]
# # Can two fingers hold a soft body by friction alone?
#
# Two fingers grip a soft body. A force pushes each finger; how far the finger travels is unknown
# and comes out. The forces grow first, and then the weight of the body comes, which friction holds:
#
#     contact:
#       - on: left
#         foundation: {cylinder: {centre: [-1, 0.9], radius: 1}, force: ["0.12*min(t, 1)", 0]}
#
# The forces tell how hard the fingers press and not where they are: body and fingers could move
# sideways together. So the bottom of the body is guided, `{on: bottom, value: [0, null]}`. Nothing
# but friction stops the body from falling.

# %%
import sys
from pathlib import Path

from matplotlib import pyplot as plt
from mpi4py import MPI

from contact_locking import StudySolution, load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD


def gripped(*changes: str) -> StudySolution:
    """The last solution of the process, or the state in which the process ends."""
    return solve(load(FILE, [*CHANGES, *changes]).parameters, comm)


held = gripped()
assert held.converged, held.summary["reason"]
write(held, held.parameters.output.directory)

# %% [markdown]
# ## The grip holds
#
# The weight is 0.084, and friction bears up to 2 · 0.4 · 0.12 = 0.096. The fingers press with their
# forces in every step, and the balance of each tool is a criterion of the certificate.

# %%
history = held.history
time = history.column("t")
if comm.rank == 0:
    for finger in held.summary["contacts"]:
        force = finger["tool"]["force"]
        travel = history.column(f"tool_travel_{finger['name']}")
        print(f"finger {finger['name']}: pushed by {force:g}, moved by {travel[-1]:.4f}")
    print(f"friction bears {history.column('friction_force_y')[-1]:.4f}")
    print(f"balance of the tools: {held.summary['certificate']['criteria']['tool_balance']}")

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    left.plot(time, history.column("tool_travel_left"), marker=".", color="#0072b2", label="left")
    left.plot(time, history.column("tool_travel_right"), marker=".", color="#d55e00", label="right")
    left.set(xlabel="t", ylabel="travel of the fingers")
    left.legend()
    right.plot(time, history.column("friction_force_y"), marker=".", label="friction force")
    right.plot(time, 0.084 * (time - 1).clip(0), "k--", label="weight")
    right.plot(time, 0.096 * time.clip(0, 1), ":", color="grey", label="most that friction bears")
    right.set(xlabel="t", ylabel="force")
    right.legend()
    figure.savefig(Path(held.parameters.output.directory) / "grip.png", dpi=110)

# %% [markdown]
# ## A weaker grip of round fingers
#
# With forces of 0.1 friction bears 0.08 and no more. All of the contact slips, the body sinks, and
# comes to rest where the body above the fingers hangs on them: the fingers are round, and their
# pressure has a vertical part.

# %%
weaker = gripped(
    "contact.0.foundation.force=['0.1*min(t, 1)', 0]",
    "contact.1.foundation.force=['-0.1*min(t, 1)', 0]",
)
assert weaker.converged, weaker.summary["reason"]
if comm.rank == 0:
    print(f"friction bears {weaker.summary['friction_force'][1]:.4f}", end=", ")
    print(f"the pressure on round fingers {weaker.summary['contact_force'][1]:.4f}")
    slips = weaker.summary["slip_area"] / weaker.summary["contact_area"]
    print(f"{100 * slips:.0f} % of the contact slips")

# %% [markdown]
# ## A weaker grip of flat fingers
#
# Flat fingers have no such part. There is no equilibrium, and the last step ends with the reason.

# %%
flat = gripped(
    "contact.0.foundation={half_space: {point: [0, 0], normal: [1, 0]}, "
    "force: ['0.1*min(t, 1)', 0]}",
    "contact.1.foundation={half_space: {point: [1, 0], normal: [-1, 0]}, "
    "force: ['-0.1*min(t, 1)', 0]}",
    "steps.least=0.2",
)
assert not flat.converged
if comm.rank == 0:
    print(f"t = {flat.time:g}: {flat.summary['reason']}")
