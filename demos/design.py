# %% [markdown]
# # Which cushion holds a part with the least pressure?
#
# A flat part that is pushed into an even cushion presses most at its edges. Foam can be printed
# with a stiffness that varies: which field $E(x)$ makes the largest pressure least? At best it is
# uniform: $F/a$, a closed form, as the pressures on the width a sum up to the force F.
#
# One solve with the last tangent gives `solution.derivative("pressure_max", E)` by all values of E.
# The largest pressure has kinks, where its place jumps. So derivatives are kept as planes, and the
# next design, by SciPy's `linprog`, is the nearby one whose highest plane is lowest.
#
#     python demos/design.py 0.05 32        force, cells along the cushion, a multiple of 16

# %%
import importlib.util
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from scipy.optimize import linprog

import contact_locking as cl

FORCE, CELLS = (float(word) for word in sys.argv[1:] or (0.05, 32))
comm, cells, crossed = MPI.COMM_WORLD, int(CELLS), mesh.DiagonalType.crossed

# %% [markdown]
# ## The cushion
#
# We see the right half of it. The design is $\ln E$ in $16 \times 8$ squares, $0.05 \le E \le 1$.

# %%
body = mesh.create_rectangle(comm, [[0, 0], [2, 1]], [cells, cells // 2], diagonal=crossed)
V, Q = fem.functionspace(body, ("P", 1, (2,))), fem.functionspace(body, ("DG", 0))
left = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[0], 0))
bottom = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], 0))
top = mesh.locate_entities_boundary(body, 1, lambda x: np.isclose(x[1], 1) & (x[0] < 1 + 1e-9))
held = fem.dirichletbc(np.zeros(2), fem.locate_dofs_topological(V, 1, bottom), V)
part = cl.Foundation(cl.HalfSpace((0, 1), (0, -1)), force=(0, -FORCE))
young, square = fem.Function(Q), fem.Function(Q)
square.interpolate(lambda x: np.floor(8 * x[0]) + 16 * np.floor(8 * x[1]))
square = np.rint(square.x.array).astype(int)
young.x.array[:] = 1.0
problem = cl.ContactProblem(
    cl.Elasticity(young=young, poisson=0.3), None, [held, cl.Support(left, along=(1, 0))],
    contacts=[cl.Contact(top, part)], space=V,
)  # fmt: skip


def pressure(design: Any) -> tuple[Any, float, Any]:
    """The solution, its largest pressure over F/a, and the derivatives of that by ln E (128,)."""
    young.x.array[:] = np.exp(design)[square]
    solution = problem.solve(certificate=False)
    assert solution.converged, solution.summary["reason"]
    slope = solution.derivative("pressure_max", young).x.array * young.x.array / FORCE
    return solution, solution.summary["pressure_max"] / FORCE, np.bincount(square, slope)


# %% [markdown]
# ## The derivatives, as a check
#
# Where all of E is multiplied by a number, no pressure changes: the derivatives by $\ln E$ have the
# sum zero. Along another direction they are a difference of two solves.

# %%
even = np.full(128, np.log(0.5))
first, peak, slope = pressure(even)
along, width = np.random.default_rng(0).normal(size=128), 1e-4
sides = [pressure(even + side * along)[1] / (2 * side) for side in (width, -width)]
print(f"largest pressure {peak:.3f} F/a; slope {slope @ along:.6f}, by solves {sum(sides):.6f}")
assert abs(slope.sum()) < 1e-8 * np.abs(slope).sum() and np.isclose(slope @ along, sum(sides), 1e-4)

# %% [markdown]
# ## The design
#
# The reach of a step grows where the largest pressure falls, and shrinks where it does not.

# %%
best, peaks, planes, reach, low = (even, first), [peak], [(peak, slope, even)], 0.5, np.log(0.05)
for _ in range(30):
    rows = np.array([[*slope, -1.0] for _, slope, _ in planes])
    limits = np.array([slope @ design - peak for peak, slope, design in planes])
    bounds = [(max(low, x - reach), min(0.0, x + reach)) for x in best[0]]
    design = linprog(np.eye(129)[-1], rows, limits, bounds=[*bounds, (1.0, None)]).x[:-1]
    solution, peak, slope = pressure(design)
    planes.append((peak, slope, design))
    reach *= 1.5 if peak < min(peaks) else 0.6
    best = (design, solution) if peak < min(peaks) else best
    peaks.append(peak)
assert (np.array(peaks) >= 1.0).all() and min(peaks) < 1.2

# %%
layout: Any = [["even", "designed"], ["pressure", "steps"]]
figure, axes = plt.subplot_mosaic(layout, figsize=(8, 4.6), layout="constrained")
for name, (design, solution) in {"even": (even, first), "designed": best}.items():
    x, y = V.tabulate_dof_coordinates()[:, :2].T + solution.displacement.x.array.reshape(-1, 2).T
    for shown in (x, -x):
        image = axes[name].tripcolor(shown, y, V.dofmap.list, np.exp(design)[square], clim=(0, 1))
    sunk = solution.summary["contacts"][0]["tool"]["travel"]
    axes[name].add_patch(plt.Rectangle((-1, 1 - sunk), 2, 0.4, color="0.6"))
    axes[name].set(aspect="equal", xlim=(-2.1, 2.1), ylim=(0, 1.4), title=name)
    axes[name].axis("off")
    points = solution.contact_points
    at, presses = np.array(sorted(zip(points.x[:, 0], points.pressure / FORCE, strict=True))).T
    both = np.append(-at[::-1], at), np.append(presses[::-1], presses)
    axes["pressure"].plot(*both, label=name)
figure.colorbar(image, ax=[axes["even"], axes["designed"]], label="E")
axes["pressure"].axhline(1.0, color="k", ls="--", lw=1, label="bound")
axes["pressure"].set(xlabel="x / a", ylabel="pressure a / F", ylim=(0, None))
axes["pressure"].legend(frameon=False)
axes["steps"].plot(np.array(peaks) - 1, "o-")
axes["steps"].set(xlabel="step", ylabel="peak / bound − 1", yscale="log")
Path("results").mkdir(exist_ok=True)
figure.savefig("results/design.png", dpi=100)

# %% [markdown]
# ## As a term of a larger model
#
# By `pip install .[adjoint]` and DOLFINx 0.10 or newer: a block of dolfinx-adjoint, and a price.

# %%
if importlib.util.find_spec("dolfinx_adjoint"):
    import pyadjoint
    from dolfinx_adjoint import Function, assemble_scalar

    class LargestPressure(pyadjoint.Block):
        def recompute_component(self, inputs: Any, *_: Any) -> float:
            young.x.array[:] = inputs[0].x.array
            self.solution = problem.solve(certificate=False)
            return self.solution.summary["pressure_max"] / FORCE

        def evaluate_adj_component(self, inputs: Any, adj_inputs: Any, *_: Any) -> Any:
            slope = self.solution.derivative("pressure_max", young).x
            slope.array[:] *= float(adj_inputs[0]) / FORCE
            return slope

    E, change, block = Function(Q), Function(Q), LargestPressure()
    E.x.array[:], change.x.array[:] = 0.5, along[square]
    block.add_dependency(E)
    value = pyadjoint.AdjFloat(block.recompute_component([E]))
    block.add_output(value.block_variable)
    pyadjoint.get_working_tape().add_block(block)
    price = 0.1 * assemble_scalar(E**2 * ufl.dx)
    model = pyadjoint.ReducedFunctional(value + price, pyadjoint.Control(E))
    assert pyadjoint.taylor_test(model, E, change) > 1.9
