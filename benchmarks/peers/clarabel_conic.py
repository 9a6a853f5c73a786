"""Clarabel: the discrete problem at n = inf as one cone programme, friction with a frozen bound.

    min  1/2 u.K u - f.u + sum_i w_i G_i t_i   with   u_y + y >= 0,  |u_x| <= t,  |eps_K| <= M

The friction bound G is that of the reference solution: a conic solver cannot find Coulomb's.
"""

from typing import Any

import clarabel
import numpy as np
import scipy.sparse as sp
from exchange import task
from simplices import Body

job = task()
problem = job.problem
body = Body(problem.x, problem.cells, problem.young, problem.poisson)
nodes = problem.contact_nodes()
# In units of this length and of Young's modulus the displacements are about one.
length = np.abs(problem.load()).sum() / problem.young
weights = body.nodal_areas(problem.parts[problem.contact])[nodes]
size, count = 2 * len(problem.x), len(nodes)
free = np.setdiff1d(np.arange(size), problem.held_dofs())
rubs = problem.friction > 0.0
columns = len(free) + count * rubs


def at(dofs: Any) -> Any:
    """The rows that take the given degrees of freedom out of the unknowns."""
    rows = sp.csc_matrix((np.ones(count), (np.arange(count), dofs)), (count, size))
    return sp.hstack([rows[:, free], sp.csc_matrix((count, columns - len(free)))])


# b - A x in the cones
rows, right, cones = (
    [-at(2 * nodes + 1)],
    [problem.x[nodes, 1] / length],
    [clarabel.NonnegativeConeT(count)],
)
if rubs:
    bounds = sp.hstack([sp.csc_matrix((count, len(free))), sp.eye(count)])
    for sign in (1.0, -1.0):
        rows.append(sign * at(2 * nodes) - bounds)
        right.append(np.zeros(count))
        cones.append(clarabel.NonnegativeConeT(count))
if np.isfinite(problem.limit):
    below = np.vstack([np.zeros((1, 3)), np.eye(3)])
    strains = sp.kron(sp.eye(len(problem.cells)), below) @ body.strain[:, free]
    rows.append(sp.hstack([-strains, sp.csc_matrix((strains.shape[0], columns - len(free)))]))
    right.append(np.kron(np.ones(len(problem.cells)), [problem.limit / length, 0.0, 0.0, 0.0]))
    cones += [clarabel.SecondOrderConeT(4)] * len(problem.cells)
stiffness = sp.block_diag(
    [body.stiffness[free][:, free], sp.csc_matrix((columns - len(free),) * 2)]
)
linear = np.concatenate([-problem.load().ravel()[free], weights * problem.bound[nodes] * rubs])

job.start()
settings = clarabel.DefaultSettings()
settings.verbose, settings.max_threads = False, 1
settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
settings.direct_solve_method = job.options.get("factorisation", "faer")
solver = clarabel.DefaultSolver(
    sp.triu(stiffness, format="csc") / problem.young,
    linear[:columns] / (problem.young * length),
    sp.vstack(rows, "csc"),
    np.concatenate(right),
    cones,
    settings,
)
solution = solver.solve()
u = np.zeros(size)
u[free] = np.array(solution.x)[: len(free)] * length
job.finish(u, solution.iterations, str(solution.status) == "Solved")
