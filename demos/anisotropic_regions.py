# %% [markdown]
# # Where does a composite with fibres lock around a stiff disc?
#
# A block reinforced by fibres at 30 degrees to the $x$ axis holds a stiff disc. The fibre
# composite locks, the disc does not. A rigid plate, glued to the top, presses the block on the
# foundation.
#
# A material may be given as the matrix of its elasticity tensor in Mandel's notation,
#
# $$\begin{pmatrix}\sigma_{xx}\\ \sigma_{yy}\\ \sqrt2\,\sigma_{xy}\end{pmatrix} = C
#   \begin{pmatrix}\varepsilon_{xx}\\ \varepsilon_{yy}\\ \sqrt2\,\varepsilon_{xy}\end{pmatrix},$$
#
# in which the norm of a tensor is the norm of its vector. So the eigenvalues of $C$ are those of
# $A$, the smallest is the constant $\alpha$ of the theory, and a rotation by $\theta$ is an
# orthogonal matrix $Q$ with $C_\theta = Q\,C\,Q^T$.

# %%
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

# Along the fibres ten times as stiff as across.
ALONG_AXES = np.array([[10.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]])


def rotated(degrees: float) -> npt.NDArray[np.float64]:
    c, s, r = np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), np.sqrt(2.0)
    q = np.array(
        [
            [c * c, s * s, -r * c * s],
            [s * s, c * c, r * c * s],
            [r * c * s, -r * c * s, c * c - s * s],
        ]
    )
    return q @ ALONG_AXES @ q.T


comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
given = np.array(parameters.material.elasticity.stiffness, dtype=float)
assert np.allclose(given, rotated(30), atol=1e-6)
assert np.allclose(np.linalg.eigvalsh(given), np.linalg.eigvalsh(ALONG_AXES), atol=1e-6)

# %%
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
summary = solution.summary
assert solution.converged, summary["reason"]

# %% [markdown]
# ## What locks carries
#
# The plate squeezes the composite above and below the disc until it locks. Disc and locked zones
# form a column that is stiffer than the rest, and the pressure under it is several times the mean.

# %%
inside = solution.domain.cells("inclusion")
locked_inside = float(comm.allreduce(solution.locked.x.array[inside].sum()))
assert locked_inside == 0 < summary["locked_fraction"]
points = solution.contact_points
if points is not None:
    mean, peak = summary["contact_force"][1], points.pressure.max()
    place = points.x[points.pressure.argmax(), 0]
    print(f"locked: {100 * summary['locked_fraction']:.1f} % of the body")
    print(f"pressure: mean {mean:.4f}, largest {peak:.4f} at x = {place:.2f}")
    assert peak > 2 * mean
    assert abs(place - 0.5) < 0.2

# %% [markdown]
# ## What the fibres do
#
# Body and loads are symmetric in the line $x = 1/2$. An isotropic block would press on the ground
# symmetrically, without a horizontal force. Fibres that lean to one side couple compression with
# shear: the plate feels a horizontal force and friction answers. Turned the other way the force
# changes sign, and with fibres along the axes it is gone.

# %%
force = {}
for degrees in (-30, 0, 30):
    stiffness = f"material.elasticity.stiffness={rotated(degrees).round(9).tolist()}"
    case = solve(load(FILE, [*CHANGES, stiffness]).parameters, comm).summary
    force[degrees] = case["friction_force"][0]
    if comm.rank == 0:
        print(
            f"fibres at {degrees:3} degrees: friction force {force[degrees]:+.5f}, "
            f"contact force {case['contact_force'][1]:.5f}"
        )
assert force[30] > 0 > force[-30]
assert abs(force[30] + force[-30]) < 0.1 * force[30]
assert abs(force[0]) < 0.1 * force[30]
