# %% [markdown]
# # Where does a pressed block lock, stick and slip?
#
# A square block is clamped on its left side $\Gamma_D$. Its top is pressed, most near the clamp,
# and its right side is lifted. Below it lies a rigid foundation: on the bottom $\Gamma_C$ the
# block may come off, stick or slip. Its material is elastic until the strain reaches a limit, and
# then locks:
#
# $$|\varepsilon(u)| \le M, \qquad \sigma = A\varepsilon(u) + Z, \qquad
#   Z = 2n\,[|\varepsilon| - M]^+ \frac{\varepsilon}{|\varepsilon|}.$$
#
# $Z$ is the stress that holds the strain back. The foundation answers with a pressure, and
# friction with a tangential traction whose bound is the smoothed pressure $R\sigma_\nu$ times
# $\mu$:
#
# $$-\sigma_\nu = \tfrac{1}{\epsilon}[u_\nu - g]^+, \qquad
#   \sigma_\tau = -\mu\,|R\sigma_\nu|\,\frac{u_\tau}{\sqrt{|u_\tau|^2 + \epsilon^2}}.$$
#
# The exact laws are the limit $n \to \infty$, $\epsilon = 1/n \to 0$. A study file without a
# penalty is solved with the exact laws. (The $\epsilon$ of friction is a length, $\epsilon E$ with
# Young's modulus $E$, which is 1 here.) This demo shows how to solve a study file from Python, the
# parts of the solution, and the error of the penalty.
#
# The study file leaves the method to the program. Here `solver.method: penalty` is the method of
# the paper: PETSc's SNES on (26), a fixed point of the friction bound around it, and larger and
# larger $n$. The folder `contact_locking/penalty_method` has its equations in UFL.
#
# Any key of the study file can be changed on the command line, here and in the other demos:
#
#     python demos/block.py mesh.h=0.05 penalty.n=1e3
#     mpirun -n 2 python demos/block.py

# %%
import sys
from pathlib import Path

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from contact_locking import load, solve, write

FILE = Path(__file__).with_suffix(".yml")
CHANGES = ["solver.method=penalty", *sys.argv[1:]]

# %% [markdown]
# ## Solve
#
# The mesh is distributed over the ranks of MPI; rank 0 alone prints. The fields for
# ParaView, the picture and the summary go to the folder that the study file names.

# %%
comm = MPI.COMM_WORLD
parameters = load(FILE, CHANGES).parameters
solution = solve(parameters, comm)
write(solution, parameters.output.directory)
summary = solution.summary
assert solution.converged, summary["reason"]
if comm.rank == 0:
    print(f"{summary['dofs']} unknowns, {summary['iterations']['tangents']} Newton steps")
    factor = summary["friction_fixed_point"]["contraction"]
    print(f"the friction bound settles with the contraction factor {factor:.2f}")
    print(f"locked: {100 * summary['locked_fraction']:.1f} % of the body")
    print(f"contact force on the body {np.round(summary['contact_force'], 6)}")
    print(f"friction force on the body {np.round(summary['friction_force'], 6)}")

# %% [markdown]
# The picture shows a locked zone of a third of the block, but the strain reaches $M$ in fewer
# cells. A mesh of triangles has about two cells and two unknowns per vertex: about half of the
# cells can be at the limit, and they keep their neighbours just below it.

# %% [markdown]
# ## What happens on $\Gamma_C$
#
# Rank 0 has all nodes of $\Gamma_C$. All three states occur: next to the clamp the block sticks,
# farther away it slips, and at the right side it has left the foundation. Friction nowhere exceeds
# its bound, and acts against the slip.

# %%
points = solution.contact_points
if points is not None:
    names = np.array(["open", "stick", "slip"])
    for i in np.linspace(0, len(points.x) - 1, 11).astype(int):
        print(
            f"x = {abs(points.x[i, 0]):.2f}  {names[points.state[i]]:5}  "
            f"pressure {points.pressure[i]:.5f}  friction {points.traction[i, 0]:+.5f}  "
            f"bound {points.bound[i]:.5f}"
        )
    assert set(names[points.state]) == {"open", "stick", "slip"}
    assert (np.linalg.norm(points.traction, axis=1) <= points.bound * (1 + 1e-12)).all()
    assert (np.sum(points.traction * points.u_tangent, axis=1) <= 0).all()

# %% [markdown]
# ## Where the work goes
#
# The solution of (25), tested with itself, is a balance of work. In equilibrium the loads do as
# much as the elastic stress, the locking stress, the foundation and friction together:
#
# $$(f, u) = a(u, u) + \int_\Omega Z : \varepsilon(u) + \int_{\Gamma_C} (-\sigma_\nu)\,u_\nu
#   - \int_{\Gamma_C} \sigma_\tau \cdot u_\tau.$$
#
# The integrals over $\Gamma_C$ are sums over its nodes, as in the discrete problem.


# %%
def work(integrand: ufl.core.expr.Expr) -> float:
    return float(comm.allreduce(fem.assemble_scalar(fem.form(integrand))))


u = solution.displacement
normal = ufl.FacetNormal(solution.domain.mesh)
on_contact = solution.domain.ds(
    parameters.contact_names, quadrature_rule="vertex", quadrature_degree=1
)
parts = {
    "elastic": 2 * summary["elastic_energy"],
    "locking": work(ufl.inner(solution.locking_stress, ufl.sym(ufl.grad(u))) * ufl.dx),
    "contact": work(solution.contact_pressure * ufl.inner(u, normal) * on_contact),
    "friction": work(-ufl.inner(solution.tangential_traction, u) * on_contact),
}
if comm.rank == 0:
    for name, value in parts.items():
        print(f"{name:8}  {value:.3e}  {100 * value / summary['compliance']:6.2f} % of the work")
assert np.isclose(sum(parts.values()), summary["compliance"], rtol=1e-6)

# %% [markdown]
# ## What the penalty costs
#
# With a finite $n$ the strain exceeds $M$ a little and the body enters the foundation a little.
# On one mesh both errors fall like $1/n$. Theorem 4.9 bounds both for every mesh, from the loads
# alone, and the summary holds these bounds beside the measured values.

# %%
excess, penetration = [], []
for n in (1e2, 1e3, 1e4):
    case = solve(load(FILE, [*CHANGES, f"penalty.n={n:g}"]).parameters, comm)
    excess.append(case.summary["strain_norm_max"] / float(parameters.material.locking_limit) - 1)
    penetration.append(case.summary["penetration_max"])
    if comm.rank == 0:
        print(f"n = {n:7g}  max|eps|/M - 1 = {excess[-1]:.1e}  penetration {penetration[-1]:.1e}")
    assert all(bound["holds"] for bound in case.summary["bounds"].values())
for errors in (excess, penetration):
    factors = np.divide(errors[:-1], errors[1:])
    assert ((factors > 4) & (factors < 25)).all(), factors
