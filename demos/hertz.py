# %% [markdown]
# # How wide is the contact of a cylinder on a plane, and what did Hertz say?
#
# This is the oldest contact problem with a known solution. A long elastic cylinder of radius $R$
# lies on a rigid plane and is pressed on it by the force $F$ per unit length. Hertz replaced the
# cylinder near the contact by a half-space and found a contact of half-width $a$ with an elliptic
# pressure:
#
# $$a = \sqrt{\frac{4 F R}{\pi E^*}}, \qquad E^* = \frac{E}{1 - \nu^2}, \qquad
#   p(x) = p_0 \sqrt{1 - (x/a)^2}, \qquad p_0 = \frac{2F}{\pi a}.$$
#
# The problem is nonlinear although the material is not: where the body touches is part of the
# answer. The gap is the distance of the arc from the half-space of the study file.

# %%
import sys
from math import pi, sqrt
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
E, nu, R, F = 200.0, 0.3, 8.0, 10.0
a = sqrt(4 * F * R * (1 - nu**2) / (pi * E))
p0 = 2 * F / (pi * a)

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
assert solution.converged, solution.summary["reason"]

# %% [markdown]
# Only the right half of the lower half is computed: $u_x = 0$ on the line of symmetry, and half
# of $F$ is spread over the flat top. Nothing but the contact holds the body vertically. So the
# contact force is known before the solve: $F/2$.

# %%
contact_force = solution.summary["contact_force"]
assert np.allclose(contact_force, [0, F / 2], rtol=1e-6, atol=1e-6 * F)

# %% [markdown]
# ## Against theory
#
# Half-width, peak pressure and the profile between them.

# %%
width = solution.summary["contact_area"]
points = solution.contact_points
if points is not None:
    peak = points.pressure.max()
    theory = p0 * np.sqrt(np.maximum(1 - (points.x[:, 0] / a) ** 2, 0))
    profile = sqrt(np.mean((points.pressure - theory) ** 2)) / p0
    print(f"half-width     {width:.4f}  theory {a:.4f}")
    print(f"peak pressure  {peak:.4f}  theory {p0:.4f}")
    print(f"profile        off by {100 * profile:.1f} % of the peak (root mean square)")
    assert abs(width / a - 1) < 0.05
    assert abs(peak / p0 - 1) < 0.05
    assert profile < 0.03

# %% [markdown]
# ## How small must $\epsilon$ be?
#
# The body enters the plane by $\epsilon p$. That must be small beside the depth of the contact,
# $a^2/R = 0.058$, or the pressure spreads: with $\epsilon = 10^{-2}$ the plane is as soft as the
# cylinder.

# %%
peaks = []
for epsilon in (1e-2, 1e-3, 1e-4):
    case = solve(load(FILE, [*CHANGES, f"penalty.epsilon={epsilon:g}"]).parameters, comm)
    peaks.append(case.summary["penetration_max"] / epsilon)
    if comm.rank == 0:
        print(
            f"epsilon = {epsilon:g}: peak pressure {peaks[-1]:.2f}, "
            f"penetration {case.summary['penetration_max'] / (a**2 / R):.4f} a^2/R"
        )
assert peaks[0] < peaks[1] < peaks[2]
assert peaks[0] < 0.8 * p0 < 0.95 * p0 < peaks[2]
