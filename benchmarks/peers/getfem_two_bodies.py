"""GetFEM: two bodies with unmatched meshes in contact with Coulomb friction, by Newton's method.

The augmented Lagrangian is in integrals over the first body, with multipliers of first degree.
``contact=raytracing`` takes the brick that sees the other body across gaps, in deformed positions;
``version`` is GetFEM's own for the other brick.  ``down`` moves the first body down for Newton's
start, as it has to touch where nothing else holds it.
"""

import getfem as gf
import numpy as np
from exchange import task
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

job = task()
problem = job.problem
gf.util_trace_level(0)
gf.util_warning_level(0)
model = gf.Model("real")
model.add_initialized_data("zero", [0.0, 0.0])
model.add_initialized_data("mu", [problem.friction])
model.add_initialized_data("r", [problem.young])

# Which body each node belongs to: the first has the part that touches.
edges = problem.cells[:, [0, 1, 1, 2]].reshape(-1, 2).T
links = coo_matrix((np.ones(edges.shape[1]), edges), shape=2 * (len(problem.x),))
body = connected_components(links)[1]
first = body == body[problem.parts[problem.contact][0, 0]]

region, fields, rules, number = {}, {}, {}, {}
for name, inside, young in (
    ("u1", first, problem.young),
    ("u2", ~first, problem.young_against),
):
    # The mesh with its boundary parts
    cells = problem.cells[inside[problem.cells[:, 0]]]
    mesh = gf.Mesh("empty", 2)
    mesh.add_convex(gf.GeoTrans("GT_PK(2,1)"), problem.x[cells].transpose(2, 1, 0))
    place = {tuple(np.round(problem.x[i], 9)): i for i in np.flatnonzero(inside)}
    points = np.array([place[tuple(np.round(point, 9))] for point in mesh.pts().T])
    outside = mesh.outer_faces()
    ends = [points[mesh.pid_in_faces(outside[:, [i]])] for i in range(outside.shape[1])]
    column = {tuple(sorted(pair)): i for i, pair in enumerate(ends)}
    own = [(key, part[inside[part[:, 0]]]) for key, part in problem.parts.items()]
    own = [(key, part) for key, part in own if len(part)]
    # A node of two parts is held by the one that holds more, as multipliers of both for it make the
    # system singular.
    own.sort(key=lambda item: -len(problem.held.get(item[0], ())))
    taken = set[int]()
    for i, (key, part) in enumerate(own):
        if key in problem.held:
            own[i] = key, part[~np.isin(part, list(taken)).any(axis=1)]
            taken |= set(part.ravel().tolist())
    for tag, (key, part) in enumerate(own, start=1):
        mesh.set_region(tag, outside[:, [column[tuple(sorted(facet))] for facet in part]])
        region[key] = tag
    # Elasticity, supports and loads
    field = gf.MeshFem(mesh, 2)
    field.set_classical_fem(1)
    rule = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(4)"))
    fields[name], rules[name] = field, rule
    number[name] = [place[tuple(np.round(x, 9))] for x in field.basic_dof_nodes()[:, ::2].T]
    model.add_fem_variable(name, field)
    for lame, value in zip(("lame", "shear"), problem.lame_of(young), strict=True):
        model.add_initialized_data(f"{lame}_{name}", [value])
    model.add_isotropic_linearized_elasticity_brick(rule, name, f"lame_{name}", f"shear_{name}")
    for key, _ in own:
        if key in problem.held:
            rows = np.diag([float(j in problem.held[key]) for j in range(2)])
            model.add_initialized_data(f"held_{key}_{name}", rows.ravel(), [2, 2])
            model.add_generalized_Dirichlet_condition_with_multipliers(
                rule, name, field, region[key], "zero", f"held_{key}_{name}"
            )
        if key in problem.tractions:
            model.add_initialized_data(f"load_{key}", problem.tractions[key])
            model.add_source_term_brick(rule, name, f"load_{key}", region[key])

# Contact and friction
assert problem.against is not None
touching, other = region[problem.contact], region[problem.against]
model.add_filtered_fem_variable("force", fields["u1"], touching)
if job.options.get("contact") == "raytracing":
    brick = model.add_integral_large_sliding_contact_brick_raytracing("r", 2.0, "mu")
    add_slave = model.add_slave_contact_boundary_to_large_sliding_contact_brick
    add_slave(brick, rules["u1"], touching, "u1", "force")
    add_master = model.add_master_contact_boundary_to_large_sliding_contact_brick
    add_master(brick, rules["u2"], other, "u2")
else:
    model.add_integral_contact_between_nonmatching_meshes_brick(
        *(rules["u1"], "u1", "u2", "force", "r", "mu", touching),
        *(other, int(job.number("version", 1))),
    )
start = np.zeros((fields["u1"].nbdof() // 2, 2))
start[:, 1] = -job.number("down", 0.0)
model.set_variable("u1", start.ravel())

# Newton's method
job.start()
iterations, converged = model.solve(
    *("max_res", 1e-7 * np.abs(problem.load()).max(), "max_iter", 200, "lsolver", "mumps"),
)
u = np.zeros(problem.x.shape)
for name, nodes in number.items():
    u[nodes] = model.variable(name).reshape(-1, 2)
tangent = "((Id(2) + Grad_u1)*([[0,-1],[1,0]]*Normal))"
friction = gf.asm_generic(rules["u1"], 0, f"force.Normalized{tangent}", touching, model)
# Where the pressure is largest, the normal is the vertical.
pressure = np.abs(model.variable("force")[1::2]).max()
job.finish(u, iterations, converged, pressure=pressure, friction=abs(friction))
