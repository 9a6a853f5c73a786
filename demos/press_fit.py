# %% [markdown]
# # How hard does a ring sit on a ring that is too large for it?
#
# Two elastic bodies touch each other. Each has a mesh of its own, and the meshes do not match on
# the circle where they meet. In the study file the contact names both sides:
#
#     contact: {on: inner, against: rim, gap: -0.01}
#
# The conditions of contact hold at the nodes of `on`, between the displacements of both sides. The
# gap adds to the distance in the mesh, which is zero here: -0.01 is the overlap of the press fit.

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
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
assert solution.converged, solution.summary["reason"]

# %% [markdown]
# ## The pressure of Lamé
#
# Both rings give way. With the overlap $\delta$ and the radii $a < b < c$ in plane stress
#
# $$ \frac{\delta}{p\,b} = \frac{1}{E_1} \left( \frac{b^2 + a^2}{b^2 - a^2} - \nu_1 \right)
#    + \frac{1}{E_2} \left( \frac{c^2 + b^2}{c^2 - b^2} + \nu_2 \right). $$

# %%
a, b, c = 0.5, 1.0, 2.0
inner = ((b**2 + a**2) / (b**2 - a**2) - 0.3) / 1.0
outer = ((c**2 + b**2) / (c**2 - b**2) + 0.2) / 3.0
exact = 0.01 / b / (inner + outer)
points = solution.contact_points
if points is not None:
    error = np.abs(points.pressure / exact - 1.0)
    print(f"pressure {points.pressure.mean():.5f}, Lame {exact:.5f}")
    print(f"error: {error.mean():.2%} in the mean, {error.max():.2%} at most")
    assert error.max() < 0.05

# %% [markdown]
# ## Action and reaction
#
# The forces on both rings are opposite: their sum is zero to rounding.

# %%
total = solution.summary["certificate"]["resultants"]["contact"]
assert np.abs(total).max() < 1e-12

# %% [markdown]
# ## A ring that locks
#
# With a limit of the strain the outer ring gives way less, and the inner ring has to give way more:
# the pressure rises by a tenth.

# %%
limit = ["material.regions.ring.locking_limit=0.0025"]
locked = solve(load(FILE, [*CHANGES, *limit]).parameters, comm)
assert locked.converged, locked.summary["reason"]
forces = [np.abs(one.summary["contact_force"]).mean() for one in (solution, locked)]
if comm.rank == 0:
    print(f"pressure with the limit over that without: {forces[1] / forces[0]:.3f}")
    print(f"share of the body that locks: {locked.summary['locked_fraction']:.3f}")
assert forces[1] > 1.02 * forces[0]
