"""What is too large for the filter is projected: CG bears any contrast, and quadratic elements."""

from __future__ import annotations

import math
from typing import Any

import pytest
from problems import block
from slow import slow
from solved_by_cg import agree, solved

from contact_locking.running import solving
from contact_locking.solver import tangent_solver
from contact_locking.solver.ksp import FILTER_LIMIT
from contact_locking.solver.multigrid import FilteredMultigrid
from contact_locking.solver.tangent_solver import MultigridTangents


def _count_iterations(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that gets the iterations of each solve without forces that follow."""
    counts: list[int] = []
    improve = MultigridTangents._improve

    def counted(self: MultigridTangents, *given: Any) -> float:
        before = self.counts.linear
        left = improve(self, *given)
        if self._follow is None:
            counts.append(self.counts.linear - before)
        return left

    monkeypatch.setattr(MultigridTangents, "_improve", counted)
    return counts


def _project_everything(monkeypatch: pytest.MonkeyPatch, dim: int) -> None:
    """Let everything be too large for the filter, from the first tangent on, for any n."""
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {dim: 0})
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


def test_users_may_factorise_instead() -> None:
    mumps = {"pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}
    agree(solved(1e4, "iterative", ksp_type="preonly", **mumps), solved(1e4, "direct"))
