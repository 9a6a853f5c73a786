# %% [markdown]
# # Why does a fabric give on the bias and not along its threads?
#
# The threads of a fabric are crimped. A small stretch only straightens them; then they resist any
# further stretch, and under pressure they buckle and do nothing. Along the unit vector $a$ of its
# threads a fabric stretches by $a \cdot \varepsilon a$. So the strain of this strip is held in
#
# $$K = \{\varepsilon : a \cdot \varepsilon\, a \le M
#   \text{ for the threads } a \text{ of warp and weft}\},$$
#
# the intersection of two half spaces. The list `material.locking` of the study file has an entry
# for each. Other entries limit the volume, the deviator, or a weighted norm of the strain; the
# strain stays in all sets of the list. The default solver treats each set as a cone, so that the
# limits are exact: n is infinite here.
#
# The strip is 2 wide and 0.5 high. Two clamps hold its ends and press it on a round bar.

# %%
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.collections import PolyCollection
from mpi4py import MPI

from contact_locking import StudySolution, load, solve, write

FloatArray = npt.NDArray[np.float64]

FILE = Path(__file__).with_suffix(".yml")
CHANGES = sys.argv[1:]
CRIMP = 0.004  # M

comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
straight = solve(parameters, comm)
write(straight, parameters.output.directory)
assert straight.converged, straight.summary["reason"]

# %% [markdown]
# ## The same fabric, cut in another direction
#
# Another list in place of that of the study file turns the threads by 45 degrees, as in cloth that
# is cut on the bias; the empty list is the coating alone.


# %%
def threads(*angles: float) -> str:
    """The limits of threads under these angles to the x axis, in degrees."""
    directions = [np.round([np.cos(a), np.sin(a)], 12).tolist() for a in np.radians(angles)]
    limits = (f"{{norm: direction, along: {a}, at_most: {CRIMP}}}" for a in directions)
    return f"material.locking=[{', '.join(limits)}]"


def solved(*changes: str) -> StudySolution:
    solution = solve(load(FILE, [*CHANGES, *changes]).parameters, comm)
    assert solution.converged, solution.summary["reason"]
    return solution


def force(solution: StudySolution) -> float:
    return float(solution.summary["contact_force"][1])


bias, coating = solved(threads(45, -45)), solved(threads())
strips = {"coating alone": coating, "straight": straight, "on the bias": bias}
if comm.rank == 0:
    print(f"{'threads':>13}  force    locked  largest strain")
    for name, solution in strips.items():
        locked, largest = (solution.summary[key] for key in ("locked_fraction", "strain_norm_max"))
        print(f"{name:>13}  {force(solution):.5f}  {100 * locked:4.0f} %  {largest:.3f}")
assert force(straight) > 1.4 * force(coating)
assert 1.2 * force(coating) < force(bias) < force(straight)
assert straight.summary["strain_norm_max"] > 5 * CRIMP

# %% [markdown]
# Straight threads hold the strip where bending stretches it: at the bottom beside the clamps, and
# at the top over the bar. Threads on the bias hold it in between, where it is sheared. Both make
# the strip stiffer, at different places. The strain itself exceeds the crimp many times: pressure
# and shear between straight threads have no limit.
#
# `summary["strain_sets"]` tells for each set how much of the limit is used at most, and in which
# share of the body all of it.

# %%
if comm.rank == 0:
    for name, solution in strips.items():
        for entry in solution.summary["strain_sets"]:
            used, share = entry["utilisation_max"], entry["locked_fraction"]
            print(f"{name}: {entry['name']}: {used:.6f} used, all of it in {100 * share:.0f} %")
for entry in straight.summary["strain_sets"] + bias.summary["strain_sets"]:
    assert abs(entry["utilisation_max"] - 1.0) < 1e-5

# %% [markdown]
# The pictures show the strips, not magnified. Cells are orange where some thread is straight and
# carries load.


# %%
def drawing(solution: StudySolution) -> tuple[FloatArray, FloatArray] | None:
    """Deformed triangles (c, 3, 2), and 1 where a cell is locked (c,), on rank 0."""
    u, locked = solution.displacement, solution.locked
    owned = u.function_space.mesh.topology.index_map(2).size_local
    x = u.function_space.tabulate_dof_coordinates()[:, :2] + u.x.array.reshape(-1, 2)
    triangles = x[u.function_space.dofmap.list[:owned]]
    values = locked.x.array[locked.function_space.dofmap.list[:owned, 0]]
    parts = comm.gather((triangles, values))
    if parts is None:
        return None
    corners, marks = (np.concatenate(part) for part in zip(*parts, strict=True))
    return corners, marks


panels = {name: drawing(solution) for name, solution in strips.items()}
if comm.rank == 0:
    figure, axes = plt.subplots(3, 1, figsize=(7, 6.4), sharex=True, layout="constrained")
    turn = np.linspace(0.0, np.pi, 200)
    for ax, (name, panel) in zip(axes, panels.items(), strict=True):
        assert panel is not None
        colours = np.where(panel[1][:, None] > 0.5, [[0.84, 0.37, 0.0]], [[0.85, 0.88, 0.92]])
        ax.add_collection(PolyCollection(list(panel[0]), facecolors=colours, edgecolors="face"))
        ax.fill(1.0 + 0.5 * np.cos(turn), -0.5 + 0.5 * np.sin(turn), color="0.75")
        ax.set(xlim=(-0.05, 2.05), ylim=(-0.22, 0.52), aspect="equal", title=f"Threads: {name}")
    figure.savefig(Path(parameters.output.directory) / "fabric.png", dpi=150)

# %% [markdown]
# ## What no thread allows
#
# Straight threads do not let the clamps be drawn apart by more than the crimp, which is 20 % of the
# displacement here. The solver proves that no displacement of the mesh follows all of it, and finds
# the share that can be followed. On the bias the strip gives way by shear.

# %%
pull = "loads.displacements=[{on: left, value: [0, 0]}, {on: right, value: [0.04, 0]}]"
alone = ("contact=[]", "penalty.n=.inf", pull)
refused = solve(load(FILE, [*CHANGES, *alone]).parameters, comm)
followed = solved(*alone, threads(45, -45))
if comm.rank == 0:
    print(refused.summary["reason"])
    print(f"on the bias the strain reaches {followed.summary['strain_norm_max']:.3f}")
assert not refused.converged
low, high = refused.summary["admissible_load_factor"]
share = 2.0 * CRIMP / 0.04
assert low <= share <= high * (1.0 + 1e-6) <= 1.02 * share
