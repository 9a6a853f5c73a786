# %% [markdown]
# # Which E, M and μ does a measured curve show?
#
# A steel cylinder is pressed into a pad of foam and dragged along it. A CSV file has the two
# forces of the testing machine over the time:
#
#     t,press,drag
#     0.1,0.0963,-0.0003
#
# The section `fit` of the study file says which column is which quantity, and which numbers of the
# file are searched between which bounds.

# %%
import sys
from pathlib import Path

from mpi4py import MPI

from contact_locking import load
from contact_locking.inverse.fitting import fit

FILE = Path(__file__).with_suffix(".yml")
parameters = load(FILE, sys.argv[1:]).parameters
found, solution = fit(parameters, parameters.output.directory, MPI.COMM_WORLD)
assert solution.converged, solution.summary["reason"]

# %% [markdown]
# ## The numbers
#
# Each evaluation is one solve of the process with its derivatives. The intervals say what the noise
# of the data leaves open: the curve was made with E = 0.8 MPa, M = 0.1 and μ = 0.3.

# %%
if MPI.COMM_WORLD.rank == 0:
    print(f"{found['evaluations']} evaluations, misfit {found['misfit']:.3g}")
    for key, entry in found["parameters"].items():
        low, high = entry["interval"]
        print(f"{key:28} {entry['value']:.4f}   95 %: {low:.4f} to {high:.4f}")

# %% [markdown]
# ## The picture
#
# `fit.png` has data, model and residuals. Residuals that keep their sign over long stretches say
# that the model lacks something: without the limit they do.

# %%
for text in [*found["words"], *found["undetermined"]]:
    print(text)
