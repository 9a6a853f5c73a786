"""The latent variable proximal point method ("proximal Galerkin") with DOLFINx, without friction.

In the step k of the proximal point method u and the latent variables psi on Gamma_C and Psi in the
body solve, for all v, w and W,

    alpha_k (a(u, v) - (f, v)) - (psi - psi_k, v_nu) + (Psi - Psi_k, eps(v)) = 0
    (g - u_nu - L exp(psi), w) = 0
    (eps(u) - M Psi/sqrt(1 + |Psi|^2), W) = 0

with L a length, so that u_nu < g and |eps(u)| < M hold in every step.  See Keith and Surowiec,
doi:10.1007/s10208-024-09681-8, and Dokken et al., doi:10.48550/arXiv.2503.05672.
"""

from typing import Any

import numpy as np
import ufl
from basix.ufl import element, mixed_element
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx_body import Body
from exchange import task
from petsc4py import PETSc

job = task()
problem = job.problem
assert problem.friction == 0.0
body, locks = Body(problem), np.isfinite(problem.limit)
cell = "triangle"
# psi lives on the whole mesh and is set to zero at the nodes off Gamma_C.
parts = [element("Lagrange", cell, 1, shape=(2,)), element("Lagrange", cell, 1)]
parts += [element("DG", cell, 0, shape=(3,))] if locks else []
W = fem.functionspace(body.mesh, mixed_element(parts))
now, before = fem.Function(W), fem.Function(W)
u, psi, *Psi = ufl.split(now)
psi_k, *Psi_k = ufl.split(before)[1:]
v, w, *T = ufl.TestFunctions(W)
alpha = fem.Constant(body.mesh, 1.0)
lumped = body.ds(body.tag[problem.contact], metadata={"quadrature_rule": "vertex"})
y = ufl.SpatialCoordinate(body.mesh)[1]
form = alpha * body.elastic(u, v)
length = np.abs(problem.load()).sum() / problem.young
form += (psi - psi_k) * v[1] * lumped + (y + u[1] - length * ufl.exp(psi)) * w * lumped
if locks:

    def strain(field: Any) -> Any:
        """The strain as a vector whose Euclidean norm is the norm of eps."""
        e = ufl.sym(ufl.grad(field))
        return ufl.as_vector([e[0, 0], e[1, 1], np.sqrt(2.0) * e[0, 1]])

    ball = problem.limit * Psi[0] / ufl.sqrt(1.0 + ufl.inner(Psi[0], Psi[0]))
    form += ufl.inner(Psi[0] - Psi_k[0], strain(v)) * ufl.dx
    form += ufl.inner(strain(u) - ball, T[0]) * ufl.dx

# Supports, and psi off Gamma_C and at the held nodes
conditions = []
for name, components in problem.held.items():
    for j in components:
        place = W.sub(0).sub(j)
        dofs = fem.locate_dofs_topological(place, 1, body.tags.find(body.tag[name]))
        conditions.append(fem.dirichletbc(0.0, dofs, place))
touches = np.zeros(len(problem.x), dtype=bool)
touches[problem.contact_nodes()] = True
at = {tuple(np.round(point, 9)): i for i, point in enumerate(problem.x)}
Q, to_parent = W.sub(1).collapse()
points = Q.tabulate_dof_coordinates()
touching = [touches[at[tuple(np.round(p[:2], 9))]] for p in points]
off = np.array(to_parent, dtype=np.int32)[~np.array(touching)]
zero = fem.Function(W)
conditions.append(fem.dirichletbc(zero, off))

F, J = fem.form(form), fem.form(ufl.derivative(form, now))
A, b = petsc.create_matrix(J), petsc.create_vector(F)
ksp = PETSc.KSP().create()
ksp.setOperators(A)
ksp.setType("preonly")
ksp.pc.setType("lu")
ksp.pc.setFactorSolverType("mumps")


def newton(tolerance: float) -> int:
    """Solve the step; the number of tangents, negative if it fails."""
    step = b.duplicate()
    for count in range(1, 61):
        A.zeroEntries()
        petsc.assemble_matrix(A, J, conditions)
        A.assemble()
        b.set(0.0)
        petsc.assemble_vector(b, F)
        petsc.set_bc(b, conditions, now.x.petsc_vec, -1.0)
        ksp.solve(b, step)
        # A full step of the latent variables may be too long, as their exponentials are not linear.
        now.x.petsc_vec.axpy(-min(1.0, longest / step.norm(PETSc.NormType.INFINITY)), step)
        if not np.isfinite(step.norm()):
            return -count
        if step.norm() < tolerance:
            return count
    return -60


job.start()
longest = job.number("longest")
total, converged, factor = 0, False, job.number("factor", 4.0)
alpha.value = job.number("alpha", 1.0)
to_u = W.sub(0).collapse()[1]
for _ in range(60):
    last = now.x.array.copy()
    count = newton(1e-6)
    total += abs(count)
    if count < 0:
        now.x.array[:] = last
        break
    change = np.linalg.norm(now.x.array[to_u] - last[to_u])
    before.x.array[:] = now.x.array
    if change < 1e-8 * np.linalg.norm(now.x.array[to_u]):
        converged = True
        break
    alpha.value *= factor
V, to_parent = W.sub(0).collapse()
values = now.x.array[to_parent].reshape(-1, 2)
points = V.tabulate_dof_coordinates()
u = np.zeros(problem.x.shape)
u[[at[tuple(np.round(p[:2], 9))] for p in points]] = values
job.finish(u, total, converged)
