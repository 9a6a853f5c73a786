# %% [markdown]
# # How large is the strain at a sharp notch?
#
# A plate with two sharp notches is pulled apart. In an elastic plate the strain at the tips has no
# bound: every finer mesh shows a larger one. A body that locks has the bound M. Where the strain
# arrives at M, the body becomes rigid against more of it, and the strain spreads to the cells
# around: the locked zone grows, and no strain concentrates.
#
# A softer law has a finite n: the stress beyond the limit is 2 n (|ε| − M), and the strain goes on
# to concentrate at the tips. This program solves the problem for any n, and for n = .inf, with the
# same method, so that both can be compared.

# %%
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib import pyplot as plt
from matplotlib.collections import PolyCollection
from mpi4py import MPI

from contact_locking import StudySolution, load, solve, write

FloatArray = npt.NDArray[np.float64]

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
LIMIT = 0.02  # M

comm = MPI.COMM_WORLD


def solved(*changes: str) -> StudySolution:
    solution = solve(load(FILE, [*CHANGES, *changes]).parameters, comm)
    assert solution.converged, solution.summary["reason"]
    return solution


rigid = solved()
directory = Path(rigid.parameters.output.directory)
write(rigid, directory)
soft = solved("penalty.n=0.3")
elastic = solved("material.locking_limit=.inf")
plates = {"n = ∞": rigid, "n = 0.3": soft, "elastic": elastic}

# %% [markdown]
# ## Strain and force
#
# The limit holds to rounding for n = ∞. The plate that locks needs a little more force than the
# softer ones: what the limit changes is the place of the strain, more than its sum.

# %%
if comm.rank == 0:
    for name, solution in plates.items():
        force = solution.summary["reactions"]["contact"][1]
        ratio = solution.summary["strain_norm_max"] / LIMIT
        locked = 100.0 * solution.summary["locked_fraction"]
        print(f"{name:>7}: largest strain {ratio:.4f} M, force {force:.5f}, locked {locked:.1f} %")
largest = [solution.summary["strain_norm_max"] / LIMIT for solution in plates.values()]
assert abs(largest[0] - 1.0) < 1e-6
assert 1.2 < largest[1] < largest[2]

# %% [markdown]
# ## The strain around the notches
#
# The cells of the computed quarter and of its mirror images have the colour of |ε|/M, in one scale
# for all plates. The locked zone of the first plate is flat at 1. In the others the strain rises to
# the tips, beyond the scale.


# %%
def cells(solution: StudySolution) -> tuple[FloatArray, FloatArray] | None:
    """The triangles (c, 3, 2) of all ranks with |eps|/M (c,), on rank 0."""
    mesh, strain = solution.domain.mesh, solution.strain_norm
    owned = mesh.topology.index_map(2).size_local
    corners = mesh.geometry.x[mesh.geometry.dofmap[:owned], :2]
    values = strain.x.array[strain.function_space.dofmap.list[:owned, 0]] / LIMIT
    parts = comm.gather((corners, values))
    if parts is None:
        return None
    triangles, ratios = (np.concatenate(part) for part in zip(*parts, strict=True))
    return triangles, ratios


drawn = {name: cells(solution) for name, solution in plates.items()}
if comm.rank == 0:
    figure, axes = plt.subplots(1, 3, figsize=(9, 3.9), sharey=True, layout="constrained")
    for ax, (name, drawing) in zip(axes, drawn.items(), strict=True):
        assert drawing is not None
        quarter = drawing[0] - [0.0, 1.5]
        plate = [quarter * [x, y] for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
        patches = PolyCollection(
            list(np.concatenate(plate)),
            array=np.tile(drawing[1], 4),
            cmap="magma_r",
            clim=(0.0, 2.0),
            edgecolors="face",
            linewidths=0.1,
        )
        ax.add_collection(patches)
        for side in (-1.0, 1.0):
            ax.plot([0.5 * side, side], [0.0, 0.0], color="white", linewidth=1.5)
        ax.set(xlim=(-1, 1), ylim=(-0.9, 0.9), aspect="equal", xticks=[], yticks=[], title=name)
    figure.colorbar(patches, ax=axes, label="|ε|/M", extend="max", shrink=0.8)
    figure.savefig(directory / "notch.png", dpi=130)

# %% [markdown]
# ## The strain ahead of the tip
#
# Along the ligament, in the cells beside the plane of symmetry, the same in one diagram.

# %%
if comm.rank == 0:
    figure, ax = plt.subplots(figsize=(6, 3.4), layout="constrained")
    for (name, drawing), colour in zip(
        drawn.items(), ("#0072b2", "#d55e00", "#999999"), strict=True
    ):
        assert drawing is not None
        centres = drawing[0].mean(axis=1)
        beside = (drawing[0][:, :, 1] > 1.5 - 1e-9).sum(axis=1) == 2
        beside &= centres[:, 0] < 0.75
        order = np.argsort(centres[beside, 0])
        places, ratios = centres[beside, 0][order], drawing[1][beside][order]
        ax.plot(places, ratios, ".-", color=colour, label=name)
    ax.axvline(0.5, color="0.8", zorder=0)
    ax.annotate("tip", (0.51, 2.3), color="0.5")
    ax.set(xlabel="x", ylabel="|ε|/M beside the ligament and the notch", ylim=(0, 2.6))
    ax.legend(frameon=False)
    figure.savefig(directory / "ligament.png", dpi=130)

# %% [markdown]
# ## A finer mesh
#
# Halving the elements at the tip raises the strain of the elastic plate, and will go on to. The
# strain of the plate that locks stays M, on every mesh.

# %%
size = rigid.parameters.mesh.geometry.h_contact
finer = {
    name: solved(f"mesh.h_contact={size / 2}", *more).summary["strain_norm_max"] / LIMIT
    for name, more in (("n = ∞", ()), ("elastic", ("material.locking_limit=.inf",)))
}
if comm.rank == 0:
    for name, ratio in finer.items():
        print(f"{name:>7}: largest strain {ratio:.4f} M on the finer mesh")
assert abs(finer["n = ∞"] - 1.0) < 1e-6
assert finer["elastic"] > 1.2 * largest[2]
