# %% [markdown]
# # How hard must one press a rubber cord to flatten it by 40 %?
#
# `ContactProblem` is about small strains, but a large deformation is a sequence of them. Around the
# displacement $U$ that a body of Neo-Hooke's rubber already has, with $F = I + \mathrm{Grad}\,U$,
# $J = \det F$ and $b = FF^T$, the Cauchy stress and the stiffness of a further displacement w are
#
# $$\sigma = \tfrac{\mu}{J}(b - I) + \tfrac{\lambda}{J} \ln J\, I, \qquad
#   a(w, v) = \int_{\Omega_U} \tfrac{\lambda}{J}\,\mathrm{div}\,w\,\mathrm{div}\,v
#   + \tfrac{2}{J}(\mu - \lambda \ln J)\,\varepsilon(w) : \varepsilon(v), \qquad
#   L(v) = -\int_{\Omega_U} \sigma : \varepsilon(v) .$$
#
# Solve with contact for w, add it to $U$, move the mesh, and repeat until w vanishes: then $\sigma$
# and the pressure of the foundations are in equilibrium, and contact has been exact in each solve.
# As `a` is a function of the strain, it lacks the part $\sigma : (\nabla w)^T \nabla v$ of Newton's
# tangent. That changes no solution; convergence is linear where the stress turns with the body.
#
#     python demos/finite_strain.py 0.4 24        share of the height, cells across the cord

# %%
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from scipy.integrate import simpson
from scipy.optimize import brentq

import contact_locking as cl

SQUEEZE, CELLS = (float(word) for word in sys.argv[1:] or (0.4, 24))
comm, cells, crossed = MPI.COMM_WORLD, int(CELLS), mesh.DiagonalType.crossed
POISSON = 0.45
MU, LAMBDA = 0.5 / (1 + POISSON), POISSON / (1 + POISSON) / (1 - 2 * POISSON)  # for E = 1


def squeeze(body: mesh.Mesh) -> list[dict[str, Any]]:
    """The states of a body of the height 1 between plates without friction, in equal steps."""
    V, Q = fem.functionspace(body, ("P", 1, (2,))), fem.functionspace(body, ("DG", 0))
    U, w, v, eye = fem.Function(V), ufl.TrialFunction(V), ufl.TestFunction(V), ufl.Identity(2)
    F = ufl.inv(eye - ufl.grad(U))  # the mesh is displaced
    J, b = ufl.det(F), F * F.T
    stress = MU / J * (b - eye) + LAMBDA / J * ufl.ln(J) * eye
    density = 0.5 * MU * (ufl.tr(b) - 2 - 2 * ufl.ln(J)) + 0.5 * LAMBDA * ufl.ln(J) ** 2
    energy, cell = fem.form(density / J * ufl.dx), ufl.TestFunction(Q)
    areas, upright = fem.form(cell * ufl.dx), fem.form(-stress[1, 1] * cell * ufl.dx)
    shear, strains = 2 / J * (MU - LAMBDA * ufl.ln(J)), [ufl.sym(ufl.grad(u)) for u in (w, v)]
    a = (LAMBDA / J * ufl.div(w) * ufl.div(v) + shear * ufl.inner(*strains)) * ufl.dx
    L = -ufl.inner(stress, strains[1]) * ufl.dx
    # By symmetry u_x = 0 on the middle line.
    spaces = V.sub(0), V.sub(0).collapse()[0]
    middle = fem.locate_dofs_geometrical(spaces, lambda x: np.isclose(x[0], 0))[0]
    held = fem.dirichletbc(0.0, middle, V.sub(0))
    upper = mesh.locate_entities_boundary(body, 1, lambda x: x[1] > 0.5 - 1e-9)
    lower = mesh.locate_entities_boundary(body, 1, lambda x: x[1] < 0.5 + 1e-9)
    node = np.empty(len(body.geometry.x), dtype=int)
    node[V.dofmap.list] = body.geometry.dofmap
    X, states = body.geometry.x[node, :2].copy(), []
    for share in np.linspace(0, SQUEEZE, 9)[1:]:
        lid = cl.Contact(upper, cl.HalfSpace((0, 1 - share / 2), (0, -1)))
        table = cl.Contact(lower, cl.HalfSpace((0, share / 2), (0, 1)))
        changes = [1.0]
        while changes[-1] > 1e-6:
            problem = cl.ContactProblem(a, L, [held], (), [lid, table])
            solution = problem.solve(certificate=False)
            problem.close()
            assert solution.converged and len(changes) < 40, solution.summary["reason"]
            U.x.array[:] += solution.displacement.x.array
            body.geometry.x[node, :2] = X + U.x.array.reshape(-1, 2)
            changes.append(np.abs(solution.displacement.x.array).max())
        force = -solution.summary["contacts"][0]["contact_force"][1]
        print(f"flattened by {share:.2f}: force {force:.4f}, {len(changes) - 1} solves", end="")
        print(f", of which the last changes {changes[-1] / changes[-2]:.2g} times the one before")
        state = {"share": share, "force": force, "energy": fem.assemble_scalar(energy)}
        pressing, area = (fem.assemble_vector(form).array for form in (upright, areas))
        state |= {"x": X + U.x.array.reshape(-1, 2), "stress": pressing / area}
        states.append(state | {"cells": V.dofmap.list})
    return states


# %% [markdown]
# ## A block, as a check
#
# Its stretches $1 - s$ and $\lambda_2$ are the same everywhere. The sides are free,
# $\mu(\lambda_2^2 - 1) + \lambda \ln J = 0$, and the force is $-\sigma_{yy}\lambda_2$.

# %%
for state in squeeze(mesh.create_rectangle(comm, [[-0.5, 0], [0.5, 1]], [2, 2])):
    high = 1 - state["share"]
    wide = brentq(lambda x, y=high: MU * (x**2 - 1) + LAMBDA * np.log(x * y), 0.5, 5)
    exact = -wide / (wide * high) * (MU * (high**2 - 1) + LAMBDA * np.log(wide * high))
    assert abs(state["force"] / exact - 1) < 1e-6

# %% [markdown]
# ## The cord
#
# The work of the plates is the energy of the cord. Lindley's formula, which engineers take for
# O-rings of rubber, is a fit to measurements: $F = E d\,(1.25\,s^{3/2} + 50\,s^6)$.

# %%
cord = mesh.create_rectangle(comm, [[-1, -1], [1, 1]], [cells, cells], diagonal=crossed)
x, y = cord.geometry.x.T[:2].copy()
cord.geometry.x[:, 0] = 0.5 * x * np.sqrt(1 - y**2 / 2)  # a square becomes a disc
cord.geometry.x[:, 1] = 0.5 * y * np.sqrt(1 - x**2 / 2) + 0.5
states = squeeze(cord)
shares, forces = (np.array([0.0, *(s[key] for s in states)]) for key in ("share", "force"))
work = simpson(forces, x=shares)
print(f"work of the plates {work:.5f}, energy of the cord {states[-1]['energy']:.5f}")
assert abs(work / states[-1]["energy"] - 1) < 5e-3
lindley = 1.25 * shares**1.5 + 50 * shares**6
assert np.allclose(forces, lindley, atol=0.04)  # a fit, for rubber that keeps its volume

# %%
layout: Any = [[0, 3, 7], ["force"] * 3]
figure, axes = plt.subplot_mosaic(layout, figsize=(8, 5.4), layout="constrained")
for number in layout[0]:
    ax, state = axes[number], states[number]
    faces = {"facecolors": state["stress"], "cmap": "magma_r", "vmin": 0, "vmax": 1}
    image = ax.tripcolor(*state["x"].T, state["cells"], **faces)
    for low in (-0.08 + state["share"] / 2, 1 - state["share"] / 2):
        ax.add_patch(plt.Rectangle((-0.9, low), 1.8, 0.08, color="0.6"))
    ax.set(aspect="equal", xlim=(-0.9, 0.9), ylim=(-0.1, 1.1), title=f"s = {state['share']:.2f}")
    ax.axis("off")
figure.colorbar(image, ax=[axes[number] for number in layout[0]], label="−σ_yy / E")
axes["force"].plot(shares, forces, "o-", label="computed")
axes["force"].plot(shares, lindley, "k--", label="Lindley's formula")
axes["force"].set(xlabel="flattened by s = 1 − height / d", ylabel="force / E d")
axes["force"].legend(frameon=False)
Path("results").mkdir(exist_ok=True)
figure.savefig("results/finite_strain.png", dpi=100)
