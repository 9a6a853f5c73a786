"""Problems drawn at random: every one is solved, or has no solution as another solver agrees."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from conic import conic_problem
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import with_changes
from scipy.spatial import cKDTree

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.process import solving
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters


def _between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.integers(0, 100).map(lambda percent: round(low + (high - low) * percent / 100.0, 6))


def _decades(low: float, high: float) -> st.SearchStrategy[float]:
    return _between(low, high).map(lambda x: float(f"{10.0**x:.3g}"))


@st.composite
def problems(draw: st.DrawFn) -> Parameters:
    """A block with a clamped side over a foundation, and all else that a study file can say."""
    dim = draw(st.sampled_from([2, 2, 3]))
    limit = draw(st.one_of(_between(0.005, 0.1), st.just(math.inf)))
    size = 0.02 if math.isinf(limit) else limit
    young = draw(_decades(-1.0, 1.0))
    elasticity: dict[str, Any] = {"young": young, "poisson": draw(_between(0.0, 0.45))}
    if draw(st.booleans()):
        count = 3 * (dim - 1)
        diagonal = draw(st.lists(_between(0.3, 3.0), min_size=count, max_size=count))
        elasticity = {"stiffness": (young * np.diag(diagonal)).tolist()}
    vector = st.lists(_between(-3.0, 3.0), min_size=dim, max_size=dim)
    displacements = [{"on": "left", "value": [0.0] * dim}]
    if draw(st.booleans()):
        moved, side = draw(vector), draw(st.sampled_from(["right", "top"]))
        # At the end of the top the left side stands still.
        value = [f"{0.4 * size * v}*x" for v in moved]
        displacements.append({"on": side, "value": value})
    slope = draw(st.sampled_from([0.0, 0.3, -0.1]))
    gap = f"{size} * ({draw(_between(-0.1, 1.0))} + {slope}*x)"
    friction = draw(st.one_of(_between(0.0, 1.0), st.just("0.6 - 0.4*s/(s + 0.01)")))
    kernel = draw(st.sampled_from(["convolution", "helmholtz"]))
    n = draw(st.one_of(_decades(0.0, 10.0), st.just(math.inf)))
    data: dict[str, Any] = {
        "mesh": {
            "builder": "block",
            "dim": dim,
            "size": [1.0] * dim,
            "h": 0.2 if dim == 2 else 0.4,
        },
        "material": {"elasticity": elasticity, "locking_limit": limit},
        "loads": {
            "body_force": [0.2 * young * size * x for x in draw(vector)],
            "tractions": [{"on": "top", "value": [young * size * x for x in draw(vector)]}],
            "displacements": displacements,
        },
        "contact": {"on": "bottom", "gap": gap},
        "friction": {"coefficient": friction, "smoothing": {"kernel": kernel, "radius": 0.3}},
        "penalty": {"n": n, "epsilon": draw(st.one_of(st.none(), _decades(-8.0, -2.0)))},
    }
    return with_changes(data)


def _is_infeasible(solution: StudySolution) -> bool:
    """The verdict of Clarabel on the inequality: penalties can hide that no field is admissible."""
    pytest.importorskip("clarabel")
    _, *moved = solution.parameters.loads.displacements
    sides = {"right": 0, "top": solution.domain.dim - 1}

    def is_moved(x: FloatArray) -> BoolArray:
        found = np.zeros(x.shape[:-1], dtype=bool)
        for displacement in moved:
            found |= x[..., sides[displacement.on[0]]] > 1.0 - 1e-9
        return found

    reference = conic_problem(
        solution,
        touches=lambda x: x[..., -1] < 1e-9,
        held=lambda x: (x[..., 0] < 1e-9) | is_moved(x),
        value=[0.0] * solution.domain.dim,
    )
    value = np.zeros((len(reference.held), solution.domain.dim))
    if moved:
        at = reference.body.x[reference.held]
        rates = [float(str(rate).removesuffix("*x")) for rate in moved[0].value]
        value[is_moved(at)] = np.outer(at[is_moved(at), 0], rates)
    points, nodes = solution.contact_points, reference.contact.nodes
    assert points is not None
    gap = points.gap[cKDTree(points.x).query(reference.body.x[nodes])[1]]
    contact = dataclasses.replace(reference.contact, gap=gap)
    limit = float(solution.parameters.material.locking_limit)
    reference = dataclasses.replace(
        reference, value=value, contact=contact, limit=limit, n=math.inf, epsilon=0.0
    )
    return "PrimalInfeasible" in str(reference.solver().solve().status)


def _is_solved_or_has_no_solution(parameters: Parameters) -> None:
    solution = solving.solve(parameters)
    summary = solution.summary
    if summary["converged"]:
        assert summary["residual"] <= parameters.solver.tolerance
    else:
        assert summary["reason"].startswith("infeasible"), (summary["reason"], parameters)
        assert _is_infeasible(solution), (summary["reason"], parameters)


@pytest.mark.slow
@pytest.mark.serial
@settings(max_examples=15, deadline=None, derandomize=True)
@given(parameters=problems())
def test_random_problems_are_solved_or_have_no_solution(parameters: Parameters) -> None:
    _is_solved_or_has_no_solution(parameters)


@pytest.mark.slow
@pytest.mark.serial
@settings(max_examples=200, deadline=None, derandomize=True)
@given(parameters=problems())
def test_two_hundred_random_problems_are_solved_or_have_no_solution(
    parameters: Parameters,
) -> None:
    _is_solved_or_has_no_solution(parameters)
