# %% [markdown]
# # Two foundations
#
# A block stands on a floor and is pushed against a round wall. In the study file, `contact` is a
# list with a section for each foundation. There is friction on both: the wall has a coefficient of
# its own, and takes everything else from the common section `friction`.

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
        key = contact.friction_key("coefficient")
        print(f"{contact.key} on {', '.join(contact.on)}: {key} = {contact.friction.coefficient}")
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
assert solution.converged, solution.summary["reason"]

# %% [markdown]
# ## Balance
#
# No displacement is prescribed, so the forces of the foundations balance the loads: 0.05 downwards
# on the top and 0.03 to the right on the left side.

# %%
forces = np.add(solution.summary["contact_force"], solution.summary["friction_force"])
assert np.allclose(forces, [-0.03, 0.05], rtol=1e-5)
