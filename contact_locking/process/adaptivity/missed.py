"""Nodes for foundations that enter between the nodes of Gamma_C.

1. Solve on the mesh of the study.
2. If the criterion about entries between the nodes holds, as for nearly all studies, this is the
   solution.
3. Refine the cells where a foundation enters by a notable depth, and those around the nodes that
   touch there.  Solve again, until several nodes see the foundation or the mesh is large.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import NotRefined
from contact_locking.mesh.domain import Domain
from contact_locking.plain_text import coordinates
from contact_locking.process.adaptivity.marking import cells_at, entered_places, only_misses
from contact_locking.process.adaptivity.refinement import finer_mesh
from contact_locking.results.contact_points import OPEN
from contact_locking.results.solution import StudySolution

# So many times cells are refined: a tool of a hundredth of a facet is seen then.
_ROUNDS = 8
# The refined mesh has at most so many times the unknowns of the first one, or so many.
_GROWTH, _SMALL = 4, 10_000
# So many nodes touch around each place that touches at all, by the dimension of the body.
_NODES = {2: 5, 3: 10}
_OWN_WAY = "; mesh.h_contact, or the section adapt, gives another mesh"


def solved_with_nodes(
    attempt: Callable[[Domain | None], StudySolution], domain: Domain | None = None
) -> StudySolution:
    """The solution of ``attempt`` on a mesh whose nodes see the foundations; collective.

    ``attempt`` solves the study on the given mesh, None for that of the study, and ``domain`` is
    the first mesh.  A warning of the solution tells of a refined mesh.  Quadrilaterals and
    hexahedra are not refined: there the criterion fails.
    """
    solution = attempt(domain)
    if not (solution.contacts and only_misses(solution) and solution.domain.kind.is_simplex):
        return solution
    first, most = solution.domain, max(_GROWTH * int(solution.summary["dofs"]), _SMALL)
    around = np.array(entered_places(solution))
    reach = max(first.facet_diameter(fields.surface.facets) for fields in solution.contacts)
    near = coordinates(around[0])
    told = f"between the nodes near ({near}) a foundation enters the body: the mesh was refined"
    for _ in range(_ROUNDS):
        points, is_near = _touching(solution, around, reach)
        entered, counts = entered_places(solution), is_near.sum(axis=0)
        few = (counts > 0) & (counts < _NODES[first.dim])
        is_seen = not entered and counts.any() and not few.any()
        if is_seen or not (solution.converged or only_misses(solution)):
            break
        marks = partial(cells_at, [*entered, *map(tuple, points[is_near.any(axis=1)])])
        try:
            finer = finer_mesh(solution, marks, most, f"{most}", may_stay_straight=True)
        except NotRefined:
            break
        text = f"{told} there, from {first.num_cells} to {finer.num_cells} cells{_OWN_WAY}"
        others = (other for other in finer.warnings if not other.startswith(told))
        solution = attempt(replace(finer, warnings=(*others, text)))
    return solution


def _touching(
    solution: StudySolution, around: FloatArray, reach: float
) -> tuple[FloatArray, BoolArray]:
    """The nodes (k, d) that touch, and which (k, m) are within reach of m places; collective."""
    comm = solution.domain.comm
    own = [fields.surface.points[fields.state != OPEN] for fields in solution.contacts]
    points = np.concatenate(comm.allgather(np.concatenate(own)))
    return points, np.linalg.norm(points[:, None] - around, axis=2) <= reach
