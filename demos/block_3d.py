# %% [markdown]
# # Which way does a block slip in three dimensions?
#
# The block of `block.py` with a depth: clamped on the left, pressed on the top, lifted on the
# right and now also drawn aside there, along $y$. Only the dimension of the formulation changes.
# In 3D slip and friction are vectors in the plane of $\Gamma_C$: Coulomb's law
#
# $$\sigma_\tau = -\mu\,|R\sigma_\nu|\,\frac{u_\tau}{\sqrt{|u_\tau|^2 + \epsilon^2}}$$
#
# couples their components. Each node finds its own direction.

# %%
import sys
from pathlib import Path

import numpy as np
from mpi4py import MPI

from contact_locking import load, solve, write
from contact_locking.results.contact_points import SLIP

comm = MPI.COMM_WORLD
parameters = load(Path(__file__).with_suffix(".yml"), sys.argv[1:]).parameters
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
summary = solution.summary
assert solution.converged, summary["reason"]
if comm.rank == 0:
    print(f"{summary['dofs']} unknowns, {summary['iterations']['tangents']} Newton steps")
    print(f"locked: {100 * summary['locked_fraction']:.1f} % of the body")
    print(f"contact force on the body {np.round(summary['contact_force'], 6)}")
    print(f"friction force on the body {np.round(summary['friction_force'], 6)}")

# %% [markdown]
# ## Forces
#
# The foundation pushes up, and friction pulls back in both directions of the plane. Its resultant
# is less than $\mu$ times the contact force, which it would reach if all of the contact slipped
# in one direction.

# %%
_, _, push = summary["contact_force"]
drag = summary["friction_force"]
assert push > 0 and drag[0] < 0 and drag[1] < 0
ratio = float(np.hypot(*drag[:2])) / push
mu = float(parameters.friction.coefficient or 0)
assert 0.5 * mu < ratio < mu
if comm.rank == 0:
    print(f"friction force : contact force = {ratio:.3f}, coefficient {mu:g}")

# %% [markdown]
# ## Directions
#
# Where the body slips, the traction on it points against the slip, whose direction turns over
# $\Gamma_C$: the whole bottom is drawn along $y$, and lifting bends it along $x$.

# %%
points = solution.contact_points
if points is not None:
    slips = points.state == SLIP
    slip, traction = points.u_tangent[slips, :2], points.traction[slips, :2]
    cosine = np.sum(slip * traction, axis=1)
    cosine /= np.linalg.norm(slip, axis=1) * np.linalg.norm(traction, axis=1)
    angle = np.degrees(np.arctan2(slip[:, 1], slip[:, 0]))
    print(
        f"{slips.sum()} of {len(slips)} nodes slip, between {angle.min():.0f} and "
        f"{angle.max():.0f} degrees to the x axis"
    )
    assert np.allclose(cosine, -1)
    assert np.ptp(angle) > 30
