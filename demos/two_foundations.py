# %% [markdown]
# # How does a block rest between a floor and a wall?
#
# A block stands on a floor and is pushed against a round wall. Nothing else holds the block: no
# displacement is prescribed. In the study file, `contact` is a list with a section for each
# foundation:
#
#     contact:
#       - on: bottom
#         gap: 0
#       - on: right
#         foundation: {cylinder: {centre: [1.5, 0.5], radius: 0.5}}
#         friction: {coefficient: 0.6}
#
# The second section has a friction coefficient of its own. Everything else about friction, and the
# friction of the first section, is that of the common section `friction`. This demo shows where
# the numbers of each foundation are, in the parameters and in the solution.

# %%
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
if comm.rank == 0:
    for contact in parameters.contacts:
        print(f"{contact.key} on {', '.join(contact.on)}: {contact.friction}")
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
assert solution.converged, solution.summary["reason"]

# %% [markdown]
# ## Balance
#
# The forces of the foundations balance the loads: 0.05 downwards on the top and 0.03 to the right
# on the left side. The summary has the totals, and below `contacts` the forces of each foundation.

# %%
summary = solution.summary
totals = np.add(summary["contact_force"], summary["friction_force"])
assert np.allclose(totals, [-0.03, 0.05], rtol=1e-5)
if comm.rank == 0:
    for entry in summary["contacts"]:
        pressing, rubbing = np.round([entry["contact_force"], entry["friction_force"]], 5)
        print(f"{entry['name']}: pressure {pressing}, friction {rubbing}")

# %% [markdown]
# The load pushes the block downwards along the wall and to the right along the floor. Friction acts
# against both slips: friction on the wall carries 22 % of the load on the top, and friction on the
# floor 39 % of the load on the side.

# %%
floor, wall = summary["contacts"]
assert 0.2 < wall["friction_force"][1] / 0.05 < 0.25
assert 0.36 < -floor["friction_force"][0] / 0.03 < 0.41

# %% [markdown]
# ## Point by point
#
# The points of contact follow contact after contact. The corner between floor and wall is a point
# of both. Every point that touches slips, so friction is at its bound everywhere: $\mu$ times the
# smoothed pressure, with $\mu = 0.3$ on the floor and $\mu = 0.6$ on the wall.

# %%
points = solution.contact_points
if points is not None:
    for given, part in zip(parameters.contacts, points.parts(), strict=True):
        touches = part.pressure > 0.01 * part.pressure.max()
        friction = np.linalg.norm(part.traction, axis=1)
        assert np.allclose(friction[touches], part.bound[touches], rtol=1e-3)
        print(
            f"{', '.join(given.on)}: {len(part)} points, {touches.sum()} touch, "
            f"peak pressure {part.pressure.max():.3f}, largest slip "
            f"{np.linalg.norm(part.u_tangent[touches], axis=1).max():.4f}"
        )
