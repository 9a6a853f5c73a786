"""What is too large for the filter is projected: CG bears any contrast, and quadratic elements."""

from __future__ import annotations

import math
from typing import Any

import pytest
from petsc4py import PETSc
from problems import block
from slow import slow
from solved_by_cg import agree, solved

from contact_locking.running import solving
from contact_locking.solver.linear import tangent_solver
from contact_locking.solver.linear.factorised import FILTER_LIMIT
from contact_locking.solver.linear.filtered_multigrid import Projection
from contact_locking.solver.linear.gmres import Gmres


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


def _count_rows(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that gets the rows of each projection."""
    counts: list[int] = []
    create = Projection.__init__

    def counted(self: Projection, rows: PETSc.Mat, *given: Any) -> None:
        counts.append(rows.getSize()[0])
        create(self, rows, *given)

    monkeypatch.setattr(Projection, "__init__", counted)
    return counts


def test_what_is_too_large_for_the_filter_is_projected_whatever_the_contrast(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _project_everything(monkeypatch, 3)
    counts = _count_iterations(monkeypatch)
    projected = solved(math.inf, "iterative")
    # At the end the stiffest cells are 1e12 times as stiff as the softest.
    assert max(counts) <= 25
    agree(projected, solved(math.inf, "direct"))


def test_one_sided_limits_of_the_strain_are_projected_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _project_everything(monkeypatch, 3)
    made = _count_rows(monkeypatch)
    # The pull stretches the body by more than this.
    limits = [{"norm": "volume", "at_most": 0.005}]
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking": limits}
    direct, projected = (
        solving.solve(
            block(3, 1 / 4, mesh__structured=True, penalty__n=math.inf, material=material,
                  solver__linear=linear)
        )
        for linear in ("direct", "iterative")
    )  # fmt: skip
    assert projected.converged, projected.summary["reason"]
    assert max(made) > 0
    agree(direct, projected)


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
