# %% [markdown]
# # Where must a mesh be fine for an error of 1 %?
#
# The block of `block.yml` with quadratic displacements. The section `adapt` of the study file asks
# for a relative error of 1 % in the energy norm, by the estimate of the certificate:
#
#     adapt: {tolerance: 0.01, share: 0.5, max_dofs: 50000}
#
# `solve` returns the solution on the last mesh. `solve_adaptively` gives the solution on each mesh,
# one after the other. Each of them is complete and has its own certificate.

# %%
import sys
from pathlib import Path

from mpi4py import MPI

from contact_locking import load, solve_adaptively, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
for solution in solve_adaptively(parameters, comm):
    last = solution.summary["adapt"]["meshes"][-1]
    if comm.rank == 0:
        print(f"{last['dofs']:6} unknowns, {last['cells']:5} cells, error {last['estimate']:.2%}")
write(solution, parameters.output.directory)
assert solution.converged, solution.summary["reason"]

# %% [markdown]
# The summary says why the loop ended, and whether the tolerance was reached.

# %%
adapted = solution.summary["adapt"]
assert adapted["meshes"][-1]["estimate"] < adapted["meshes"][0]["estimate"]
assert adapted["reached"] == (adapted["meshes"][-1]["estimate"] <= adapted["tolerance"])
if comm.rank == 0:
    print(f"reached: {adapted['reached']}, {adapted['stopped']}")
