# %% [markdown]
# # Where does a ball stick that is pushed along a plane?
#
# Half of an elastic ball is pressed on a rigid plane, and pushed along it by less than friction
# can hold. In the plane's frictionless contact Hertz found, for the approach $d$,
#
# $$a = \sqrt{R d}, \qquad P = \tfrac43 E^* \sqrt{R}\, d^{3/2}, \qquad
#   p_0 = \frac{3P}{2\pi a^2}.$$
#
# Cattaneo and Mindlin added a tangential force $T < \mu P$: sliding begins at the rim of the
# contact, where the pressure is small, and the middle still sticks. In their theory the stick
# zone is a disc of radius $c$ with $(c/a)^3 = 1 - T/(\mu P)$. Here friction depends on
# the total slip $u_\tau$ and not on the path, and pressing alone already moves the rim inwards. So
# the ring of slip is wider behind, and the stick zone lies towards the front.

# %%
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking import load, solve, write
from contact_locking.results.contact_points import OPEN, SLIP, STICK

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
summary = solution.summary
assert solution.converged, summary["reason"]

# %% [markdown]
# ## Forces
#
# The friction force lies against the push, within its bound.

# %%
P, T = summary["contact_force"][2], -summary["friction_force"][0]
mu = float(parameters.friction.coefficient or 0)
if comm.rank == 0:
    print(f"P = {P:.5f}, T = {T:.5f}, T/(mu P) = {T / (mu * P):.2f}")
assert 0 < T < mu * P
assert abs(summary["friction_force"][1]) < 0.02 * T

# %% [markdown]
# ## Stick in the middle, slip at the rim

# %%
points = solution.contact_points
if points is not None:
    distance = np.hypot(points.x[:, 0], points.x[:, 1])
    reach = {state: distance[points.state == state].mean() for state in (STICK, SLIP, OPEN)}
    share = 1 - summary["slip_area"] / summary["contact_area"]
    print(
        f"mean distance from the axis: stick {reach[STICK]:.3f}, slip {reach[SLIP]:.3f}, "
        f"open {reach[OPEN]:.3f}"
    )
    print(
        f"stick: {100 * share:.0f} % of the contact, "
        f"Mindlin {100 * (1 - T / (mu * P)) ** (2 / 3):.0f} %"
    )
    assert reach[STICK] < reach[SLIP] < reach[OPEN]
    forward = points.x[points.state == STICK, 0].mean()
    assert forward > 0

# %% [markdown]
# ## On another ball
#
# The foundation may be round. On a rigid ball of the same radius the relative curvature doubles,
# so the same approach makes a smaller contact and needs less force: by Hertz $\sqrt{R^*}$ with
# $1/R^* = 1/R + 1/R$, that is $1/\sqrt2$ of it.

# %%
ball = "contact.foundation={sphere: {centre: [0, 0, -1], radius: 1}}"
case = solve(load(FILE, [*CHANGES, ball]).parameters, comm).summary
assert case["converged"], case["reason"]
if comm.rank == 0:
    print(
        f"on a ball: contact force {case['contact_force'][2] / P:.2f} of that on the plane, "
        f"contact area {case['contact_area'] / summary['contact_area']:.2f}"
    )
assert 0.55 < case["contact_force"][2] / P < 0.85
assert case["contact_area"] < summary["contact_area"]
