"""The stresses of the guaranteed bound and Korn's constant, against splines and polynomials."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from bounded_block import benchmark
from dolfinx import fem
from mpi4py import MPI

from contact_locking.running.solving import SolvableStudy
from contact_locking.study.assembly import assemble
from contact_locking.theory.guaranteed.body import Body
from contact_locking.theory.guaranteed.boundary import (
    balanced_forces,
    balanced_loads,
    contact_tractions,
    held_components,
)
from contact_locking.theory.guaranteed.triangles import Triangles, macro_element, product_integral

#: Limits at the corners hold in whole cells.
QUADRATIC = {"degree": 2}


@pytest.mark.parametrize("changes", [{}, {"discretisation": QUADRATIC}])
def test_the_stress_does_the_work_of_loads_and_contact_along_every_displacement(
    changes: dict[str, Any],
) -> None:
    # The top is loaded, the right side is clamped; rollers hold the left side along y alone.
    support = [{"on": "right", "value": [0.0, 0.0]}, {"on": "left", "value": [None, 0.0]}]
    pull = [{"on": "top", "value": [-0.03, -0.05]}]
    loads = {"displacements": support, "tractions": pull, "body_force": [0.01, -0.02]}
    changes = {"material__locking_limit": 0.02, "loads": loads} | changes
    solver = SolvableStudy(assemble(benchmark(4, **changes), MPI.COMM_WORLD)).solver
    state = solver.state(solver.solve())
    problem = state.problem
    triangles = Triangles(problem.domain)
    element = macro_element(problem.element.degree)
    balanced = balanced_loads(problem.data, triangles, element)
    contacts = [contact_tractions(fields, triangles) for fields in state.contacts]
    body, held = Body(state, triangles, element), held_components(state, triangles)
    forces = balanced_forces(triangles, held, balanced, contacts)
    stress = body.balanced(forces, problem.u)

    v = fem.Function(problem.u.function_space)
    v.interpolate(lambda x: np.stack([np.sin(3.0 * x[0] + x[1]), np.cos(x[0] - 2.0 * x[1])]))
    v.x.array[problem.constraints.dofs] = 0.0
    strains = body.strains(v)
    inner = np.sum(stress * (element.mass @ strains), axis=(1, 2, 3))
    work = state.sum(inner * triangles.areas / 3.0)
    for contact in contacts:
        normal, tangent = contact.split(v.x.array.reshape(-1, 2))
        pushed = product_integral(contact.along, tangent) - product_integral(
            contact.pressure, normal
        )
        work -= state.sum(contact.lengths * pushed)
    owned = 2 * v.function_space.dofmap.index_map.size_local
    outer = state.sum(state.system.forms.loads()[:owned] * v.x.array[:owned])
    assert work == pytest.approx(outer, rel=1e-8, abs=1e-10)
