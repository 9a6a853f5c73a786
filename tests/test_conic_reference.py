"""V13: the solution against Clarabel's of the same discrete problem at the same friction bound."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conic import Body, ConicProblem, Contact
from problems import block, with_changes
from scipy.spatial import cKDTree

from contact_locking import problem
from contact_locking.parameters import Parameters
from contact_locking.solution import Solution

pytest.importorskip("clarabel")
pytestmark = pytest.mark.serial

FloatArray = npt.NDArray[np.float64]
Place = Callable[[FloatArray], Any]

LIMIT, REACH = 0.02, 0.4
TIGHT = {"tol_gap_rel": 1e-10, "tol_gap_abs": 1e-12, "tol_feas": 1e-11}


def half_disc() -> Parameters:
    """Pressed onto a plane and pushed along it, by displacements of its flat top."""
    data: dict[str, Any] = {
        "mesh": {"builder": "disc", "contact_width": REACH, "h": 0.1},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": LIMIT},
        "loads": {"displacements": [{"on": "top", "value": [0.004, -0.012]}]},
        "contact": {
            "on": "contact",
            "foundation": {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}},
        },
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 0.1}},
        "penalty": {"n": math.inf},
    }
    return with_changes(data)


def conic_problem(
    solution: Solution,
    touches: Place,
    held: Place,
    value: list[float],
    pulled: Place | None = None,
    traction: list[float] | None = None,
    **penalty: float,
) -> ConicProblem:
    """Places are those of nodes (..., d); below the body is the plane through the origin."""
    space = solution.displacement.function_space
    dim = solution.domain.dim
    x = space.tabulate_dof_coordinates()[:, :dim]
    body = Body(x, space.dofmap.list, 1.0, 0.3)
    load = np.zeros(x.shape)
    if pulled is not None:
        load += np.multiply.outer(body.nodal_areas(body.facets(pulled)), traction)
    areas = body.nodal_areas(body.facets(touches))
    areas[held(x)] = 0.0
    nodes = np.flatnonzero(areas)
    points = solution.contact_points
    assert points is not None
    distance, match = cKDTree(points.x).query(x[nodes])
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    contact = Contact(nodes, areas[nodes], x[nodes, -1], points.bound[match], -np.eye(dim)[-1])
    return ConicProblem(
        body, LIMIT, load.ravel(), np.flatnonzero(held(x)), np.array(value), contact, **penalty
    )
