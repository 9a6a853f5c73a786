"""PETSc's reduced-space Newton method for variational inequalities (vinewtonrsls), with DOLFINx.

Without friction, and above a plane, Signorini's problem has bounds on degrees of freedom only.
"""

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx_body import Body
from exchange import task
from petsc4py import PETSc

job = task()
problem = job.problem
assert problem.friction == 0.0 and not np.isfinite(problem.limit)
body = Body(problem)
u, v, du = fem.Function(body.V), ufl.TestFunction(body.V), ufl.TrialFunction(body.V)
residual = body.elastic(u, v)
F, J = fem.form(residual), fem.form(ufl.derivative(residual, u, du))
low = np.full(2 * len(problem.x), PETSc.NINFINITY)
nodes = body.own[problem.contact_nodes()]
low[2 * nodes + 1] = -problem.x[problem.contact_nodes(), 1]

A, b = petsc.create_matrix(J), petsc.create_vector(F)
lower, upper = b.duplicate(), b.duplicate()
lower.array, upper.array = low, np.full(len(low), PETSc.INFINITY)


def assemble_residual(snes: PETSc.SNES, x: PETSc.Vec, f: PETSc.Vec) -> None:
    """F(x), with the supports."""
    x.copy(u.x.petsc_vec)
    f.set(0.0)
    petsc.assemble_vector(f, F)
    petsc.set_bc(f, body.conditions, x, -1.0)


def assemble_tangent(
    snes: PETSc.SNES, x: PETSc.Vec, jacobian: PETSc.Mat, preconditioner: PETSc.Mat
) -> None:
    """The tangent, with the supports."""
    jacobian.zeroEntries()
    petsc.assemble_matrix(jacobian, J, body.conditions)
    jacobian.assemble()


snes = PETSc.SNES().create()
snes.setType("vinewtonrsls")
snes.setFunction(assemble_residual, b)
snes.setJacobian(assemble_tangent, A)
snes.setVariableBounds(lower, upper)
snes.setTolerances(atol=1e-8 * np.abs(problem.load()).max(), rtol=0.0, max_it=200)
snes.ksp.setType("preonly")
snes.ksp.pc.setType("lu")
snes.ksp.pc.setFactorSolverType("mumps")
x = b.duplicate()
job.start()
snes.solve(None, x)
job.finish(x.array.reshape(-1, 2)[body.own], snes.its, snes.is_converged)
