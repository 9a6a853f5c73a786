"""GMRES with one tangent after another: with the filter, without it, and with users' options."""

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
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid
from contact_locking.solver.linear.ksp import LINEAR_SOLVERS, default_options

_NEVER = 10**6
FACTORISES = {"ksp_type": "preonly", "pc_type": "cholesky", "pc_factor_mat_solver_type": "mumps"}


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


def test_inexact_solves_take_three_tangents_more_at_most_at_n_infinite() -> None:
    exact, inexact = (
        solved(math.inf, linear).summary["iterations"]["tangents"]
        for linear in ("direct", "iterative")
    )
    assert inexact <= exact + 3


def test_users_may_factorise_instead() -> None:
    agree(solved(1e4, "iterative", **FACTORISES), solved(1e4, "direct"))


@pytest.mark.slow
def test_users_may_precondition_otherwise() -> None:
    by_gamg = solved(1e2, "iterative", pc_type="gamg", ksp_rtol="1e-10")
    agree(by_gamg, solved(1e2, "direct"))


def test_another_linear_solver_is_an_entry_of_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    by_diagonal = {"ksp_type": "cg", "pc_type": "jacobi", "ksp_rtol": 1e-10, "ksp_max_it": 10_000}
    monkeypatch.setitem(LINEAR_SOLVERS, "diagonal", lambda comm: dict(by_diagonal))
    given = block(2, 0.25, penalty__n=1e2)
    solver = given.solver.model_copy(update={"linear": "diagonal"})
    by_default = solving.solve(given)
    by_entry = solving.solve(given.model_copy(update={"solver": solver}))
    assert by_entry.converged, by_entry.summary["reason"]
    assert by_entry.summary["iterations"]["linear"] > by_default.summary["iterations"]["linear"]
    # Without a direct solver Newton does not polish: what the duality gap leaves is a square.
    u, expected = by_entry.displacement.x.array, by_default.displacement.x.array
    assert np.abs(u - expected).max() <= 1e-4 * np.abs(expected).max()


def test_a_linear_solver_without_an_entry_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputError, match="there are: auto, direct, iterative"):
        default_options("dirct", 2, 100, MPI.COMM_SELF)
