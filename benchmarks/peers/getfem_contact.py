"""GetFEM: contact with a rigid obstacle and Coulomb friction, by Newton's method.

``contact`` is ``penalty`` (penalised, with ``n``), ``integral`` or ``nodal``: the augmented
Lagrangian with multipliers in the space of the displacement, or at the nodes.  A strain limit is
penalised in GetFEM's language for weak forms with the same ``n``, as GetFEM has none.
``factor`` raises n from 1 by this factor, each solve from the last; without it there is one solve.
``version`` and ``search`` are GetFEM's own: of the augmented Lagrangian, and of the line search.
"""

import getfem as gf
import numpy as np
from exchange import task

job = task()
problem, contact = job.problem, job.options["contact"]
gf.util_trace_level(0)
gf.util_warning_level(0)

# The mesh with its boundary parts
mesh = gf.Mesh("empty", 2)
mesh.add_convex(gf.GeoTrans("GT_PK(2,1)"), problem.x[problem.cells].transpose(2, 1, 0))
number = {tuple(np.round(point, 9)): i for i, point in enumerate(problem.x)}
points = np.array([number[tuple(np.round(point, 9))] for point in mesh.pts().T])
outside = mesh.outer_faces()
ends = [points[mesh.pid_in_faces(outside[:, [i]])] for i in range(outside.shape[1])]
column = {tuple(sorted(pair)): i for i, pair in enumerate(ends)}
region = {}
for tag, (name, part) in enumerate(problem.parts.items(), start=1):
    mesh.set_region(tag, outside[:, [column[tuple(sorted(facet))] for facet in part]])
    region[name] = tag
touching = region[problem.contact]

# Elasticity, supports and loads
mfu, mfs = gf.MeshFem(mesh, 2), gf.MeshFem(mesh, 1)
mfu.set_classical_fem(1)
mfs.set_classical_fem(1)
mim = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(4)"))
model = gf.Model("real")
model.add_fem_variable("u", mfu)
model.add_initialized_data("lame", [problem.lame[0]])
model.add_initialized_data("shear", [problem.lame[1]])
model.add_isotropic_linearized_elasticity_brick(mim, "u", "lame", "shear")
model.add_initialized_data("zero", [0.0, 0.0])
for name, components in problem.held.items():
    rows = np.diag([float(j in components) for j in range(2)])
    model.add_initialized_data(f"held_{name}", rows.ravel(), [2, 2])
    model.add_generalized_Dirichlet_condition_with_multipliers(
        mim, "u", mfu, region[name], "zero", f"held_{name}"
    )
for name, traction in problem.tractions.items():
    model.add_initialized_data(f"load_{name}", traction)
    model.add_source_term_brick(mim, "u", f"load_{name}", region[name])

# The strain limit: the derivative of n [|eps| - M]^2
model.add_initialized_data("n", [1.0])
model.add_initialized_data("limit", [problem.limit])
if np.isfinite(problem.limit):
    size = "sqrt(Norm_sqr(Sym(Grad_u)) + 1e-30)"
    stress = f"2*n*pos_part({size} - limit)*Sym(Grad_u)/({size})"
    model.add_nonlinear_term(mim, f"({stress}):Grad_Test_u")

# Contact and friction
model.add_initialized_data("mu", [problem.friction])
model.add_initialized_data("r", [problem.young])
model.add_initialized_fem_data("obstacle", mfs, mfs.basic_dof_nodes()[1])
friction = ["mu"] if problem.friction > 0.0 else []
version = int(job.number("version", 2))
if contact == "penalty":
    model.add_penalized_contact_with_rigid_obstacle_brick(
        mim, "u", "obstacle", "n", *friction, touching
    )
elif contact == "integral":
    mfl = mfu if friction else mfs
    model.add_filtered_fem_variable("force", mfl, touching)
    model.add_integral_contact_with_rigid_obstacle_brick(
        mim, "u", "force", "obstacle", "r", *friction, touching, version
    )
else:
    count = len(mfu.basic_dof_on_region(touching)) // 2
    forces = ["normal", "tangent"] if friction else ["normal"]
    for name in forces:
        model.add_variable(name, count)
    model.add_nodal_contact_with_rigid_obstacle_brick(
        mim, "u", *forces, "r", *friction, touching, "y", version
    )

# Newton's method
job.start()
last = job.number("n", 1.0)
factor = job.number("factor")
values = [factor**k for k in range(100) if factor**k < last] if np.isfinite(factor) else []
iterations, converged = 0, False
for n in [*values, last]:
    model.set_variable("n", [n])
    steps, converged = model.solve(
        *("max_res", 1e-7 * np.abs(problem.load()).max(), "max_iter", 200, "lsolver", "mumps"),
        *("lsearch", job.options.get("search", "default")),
    )
    iterations += steps
    if not converged:
        break
u = np.zeros(problem.x.shape)
nodes = [number[tuple(np.round(point, 9))] for point in mfu.basic_dof_nodes()[:, ::2].T]
u[nodes] = model.variable("u").reshape(-1, 2)
job.finish(u, iterations, converged)
