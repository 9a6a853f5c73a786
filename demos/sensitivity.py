# %% [markdown]
# # Which number matters most for the force of a gripper?
#
# Two fingers grip a soft body by a force, and its lower side is pulled down. The force that holds
# it then is a result. A section of the study file asks how it changes with other numbers:
#
#     sensitivities:
#       of: [reactions.bottom.1]
#       to: [parameters.mu, parameters.grip, material.elasticity.young]
#
# The derivatives take no further solve of the process, but the last tangent of each step.

# %%
import sys
from pathlib import Path

from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
solution = solve(load(FILE, sys.argv[1:]).parameters, MPI.COMM_WORLD)
assert solution.converged, solution.summary["reason"]
write(solution, solution.parameters.output.directory)

# %% [markdown]
# ## The table
#
# The elasticity is what 1 % more of a number does to the force, in per cent.

# %%
found = solution.summary["sensitivities"]["reactions.bottom.1"]
if MPI.COMM_WORLD.rank == 0:
    for key, entry in sorted(found.items(), key=lambda item: -abs(item[1]["elasticity"])):
        print(f"{key:40} {entry['elasticity']:+8.3f} %")
    print(solution.summary["share_at_change"]["in_words"])
