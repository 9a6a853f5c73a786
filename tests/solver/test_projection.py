"""What is too large for the filter is projected: CG bears any contrast, and quadratic elements."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from slow import slow
from solved_by_cg import agree, solved

from contact_locking.errors import InputError
from contact_locking.running import solving
from contact_locking.solver.linear import tangent_solver
from contact_locking.solver.linear.factorised import FILTER_LIMIT
from contact_locking.solver.linear.gmres import Gmres
from contact_locking.solver.linear.ksp import LINEAR_SOLVERS, default_options
from contact_locking.solver.linear.multigrid import FilteredMultigrid


def _count_iterations(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that gets the iterations of each solve without forces that follow."""
    counts: list[int] = []
    solve = Gmres.solve

    def counted(self: Gmres, *given: Any) -> tuple[int, float]:
        count, left = solve(self, *given)
        if given[-1] is None:
            counts.append(count)
        return count, left

    monkeypatch.setattr(Gmres, "solve", counted)
    return counts


def _project_everything(monkeypatch: pytest.MonkeyPatch, dim: int) -> None:
    """Let everything be too large for the filter, from the first tangent on, for any n."""
    for name in ("_PATIENCE_OF_PROJECTION", "_LONGER_PATIENCE"):
        monkeypatch.setattr(tangent_solver, name, 0)
    for degree in (1, 2):
        monkeypatch.setitem(FILTER_LIMIT, (dim, degree), 0)


def test_what_is_too_large_for_the_filter_is_projected_whatever_the_contrast(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _project_everything(monkeypatch, 3)
    counts = _count_iterations(monkeypatch)
    projected = solved(math.inf, "iterative")
    # At the end the stiffest cells are 1e12 times as stiff as the softest.
    assert max(counts) <= 25
    agree(projected, solved(math.inf, "direct"))


@pytest.mark.parametrize(("dim", "divisions"), [(2, 12), slow(3, 4)])
def test_projection_of_quadratic_elements_bears_any_contrast(
    monkeypatch: pytest.MonkeyPatch, dim: int, divisions: int
) -> None:
    _project_everything(monkeypatch, dim)
    counts = _count_iterations(monkeypatch)
    direct, projected = (
        solving.solve(
            block(dim, 1 / divisions, mesh__structured=True, penalty__n=math.inf,
                  discretisation__degree=2, solver__linear=linear)
        )
        for linear in ("direct", "iterative")
    )  # fmt: skip
    assert projected.converged, projected.summary["reason"]
    assert max(counts) <= 60
    agree(direct, projected)


_NEVER = 10**6


@pytest.fixture
def filterings(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many nodes of this rank were filtered, each time that there was a filter."""
    counts: list[int] = []
    refresh = FilteredMultigrid.refresh

    def counted(self: FilteredMultigrid, filtered: Any = None, **named: Any) -> None:
        refresh(self, filtered, **named)
        if filtered is not None:
            counts.append(len(filtered.nodes))

    monkeypatch.setattr(FilteredMultigrid, "refresh", counted)
    return counts


@pytest.mark.parametrize(
    "patience", [slow(0), 40, slow(_NEVER)], ids=["at once", "on the way", "never"]
)
def test_whenever_the_filter_begins_the_solution_is_that_of_the_direct_solver(
    patience: int, filterings: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: patience})
    by_cg = solved(1e4, "iterative")
    tangents = by_cg.summary["iterations"]["tangents"]
    if patience == _NEVER:
        assert not filterings
    elif patience == 0:
        # Nothing is stiff at the start, where all cells are alike.
        assert tangents - 4 <= len(filterings) < tangents
    else:
        assert 2 <= len(filterings) < tangents - 4
    agree(by_cg, solved(1e4, "direct"))


def test_another_linear_solver_is_an_entry_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    by_diagonal = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_rtol": 1e-10, "ksp_max_it": 10_000}
    monkeypatch.setitem(LINEAR_SOLVERS, "diagonal", lambda comm: dict(by_diagonal))
    given = block(2, 0.25, penalty__n=1e2)
    solver = given.solver.model_copy(update={"linear": "diagonal"})
    by_default = solving.solve(given)
    by_entry = solving.solve(given.model_copy(update={"solver": solver}))
    assert by_entry.converged, by_entry.summary["reason"]
    assert by_entry.summary["iterations"]["linear"] > by_default.summary["iterations"]["linear"]
    # Without a direct solver the pieces do not finish: what the duality gap leaves is a square.
    u, expected = by_entry.displacement.x.array, by_default.displacement.x.array
    assert np.abs(u - expected).max() <= 1e-4 * np.abs(expected).max()


def test_a_linear_solver_without_an_entry_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputError, match="there are: auto, direct, iterative"):
        default_options("dirct", 2, 100, MPI.COMM_SELF)
