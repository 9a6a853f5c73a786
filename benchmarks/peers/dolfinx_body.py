"""The body of a problem in DOLFINx: the mesh with its parts, supports and loads, for two peers."""

from typing import Any

import basix.ufl
import numpy as np
import ufl
from dolfinx import default_scalar_type, fem, mesh
from exchange import Problem
from mpi4py import MPI


class Body:
    """Mesh, space, supports, and the elastic energy's derivative of a problem."""

    def __init__(self, problem: Problem) -> None:
        shape = ufl.Mesh(basix.ufl.element("Lagrange", "triangle", 1, shape=(2,)))
        self.mesh = mesh.create_mesh(
            MPI.COMM_SELF, problem.cells.astype(np.int64), problem.x, shape
        )
        self.mesh.topology.create_connectivity(1, 2)
        self.V = fem.functionspace(self.mesh, ("Lagrange", 1, (2,)))
        place = {tuple(np.round(x, 9)): i for i, x in enumerate(problem.x)}
        # The number of each node of the space in the order of the problem.
        self.number = np.array(
            [place[tuple(np.round(x[:2], 9))] for x in self.V.tabulate_dof_coordinates()]
        )
        self.own = np.argsort(self.number)
        # Boundary parts, by the numbers of their nodes in the problem.
        self.tag = {name: tag for tag, name in enumerate(problem.parts, 1)}
        tags = {
            tuple(sorted(facet)): self.tag[name]
            for name, part in problem.parts.items()
            for facet in part
        }
        outside = np.sort(mesh.exterior_facet_indices(self.mesh.topology))
        ends = mesh.entities_to_geometry(self.mesh, 1, outside)
        pairs = np.sort(self.mesh.geometry.input_global_indices[ends], axis=1)
        values = np.array([tags[tuple(pair)] for pair in pairs], dtype=np.int32)
        self.tags = mesh.meshtags(self.mesh, 1, outside, values)
        self.ds = ufl.Measure("ds", domain=self.mesh, subdomain_data=self.tags)
        zero = default_scalar_type(0.0)
        self.conditions = [
            fem.dirichletbc(
                zero,
                fem.locate_dofs_topological(self.V.sub(j), 1, self.tags.find(self.tag[name])),
                self.V.sub(j),
            )
            for name, components in problem.held.items()
            for j in components
        ]
        self._problem = problem

    def elastic(self, u: Any, v: Any) -> Any:
        """a(u, v) - (f, v)."""
        lame, shear = self._problem.lame
        stress = 2.0 * shear * ufl.sym(ufl.grad(u)) + lame * ufl.div(u) * ufl.Identity(2)
        form = ufl.inner(stress, ufl.sym(ufl.grad(v))) * ufl.dx(self.mesh)
        for name, traction in self._problem.tractions.items():
            form -= ufl.inner(fem.Constant(self.mesh, traction), v) * self.ds(self.tag[name])
        return form
