"""GMRES with one tangent after another: with the filter, without it, and with users' options."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from problems import block
from slow import slow
from solved_by_cg import agree, solved

from contact_locking.errors import InputError
from contact_locking.process import solving
from contact_locking.solver.interior_point.contact_nodes import ContactNodes
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.linear import tangent_solver
from contact_locking.solver.linear.filtered_multigrid import Filter, FilteredMultigrid
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


def test_one_symbolic_factorisation_serves_most_filters(
    filterings: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Filter] = []
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: 50})
    create = Filter.__init__

    def kept(self: Filter, *given: Any) -> None:
        create(self, *given)
        made.append(self)

    monkeypatch.setattr(Filter, "__init__", kept)
    solved(math.inf, "iterative")
    assert 1 <= len(made) <= 2 < 5 <= len(filterings)


def test_filters_take_in_all_that_is_stiff(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: 0})
    refresh, filtered = FilteredMultigrid.refresh, 0

    def seen(self: FilteredMultigrid, stiff: Any = None, **named: Any) -> None:
        nonlocal filtered
        refresh(self, stiff, **named)
        if stiff is not None:
            assert self._filter is not None and self._filter.serves(stiff.nodes)
            assert np.isin(stiff.nodes, self._filter._nodes).all()
            filtered += 1

    monkeypatch.setattr(FilteredMultigrid, "refresh", seen)
    solved(math.inf, "iterative")
    assert filtered


def test_the_filter_takes_iterations_away(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = []
    for patience in (0, _NEVER):
        monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: patience})
        counts.append(solved(1e4, "iterative").summary["iterations"]["linear"])
    assert 2 * counts[0] < counts[1]


def test_stiff_rows_and_what_is_left_make_up_the_tangent(monkeypatch: pytest.MonkeyPatch) -> None:
    refresh, counts = Tangent.refresh, []

    def compared(self: Tangent) -> None:
        refresh(self)
        stiff = self.stiff_part()
        rows, stiffness = stiff.find_rows()
        left = self.matrix.duplicate()
        stiff.assemble_across(left)
        counts.append(rows.getSize()[0])
        # A random displacement shows everything that is missing.
        step, forces = self.matrix.createVecs()
        anything = np.random.default_rng(1).standard_normal(step.getLocalSize())
        step.array_w[:] = self.system.constraints.free_part(anything)
        other, stretched = forces.duplicate(), rows.createVecLeft()
        self.matrix.mult(step, forces)
        rows.mult(step, stretched)
        stretched.array_w[:] *= stiffness
        left.mult(step, other)
        rows.multTransposeAdd(stretched, other, other)
        other.axpy(-1.0, forces)
        assert other.norm() <= 1e-12 * forces.norm()
        for item in (rows, left, step, forces, other, stretched):
            item.destroy()

    monkeypatch.setattr(Tangent, "refresh", compared)
    # Control values of the contact couple several nodes.
    solving.solve(block(2, 1 / 4, penalty__n=math.inf, discretisation__degree=2))
    assert max(counts) > 0


@pytest.mark.slow
def test_where_cg_of_a_user_breaks_down_the_residual_is_filtered_again_and_cg_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: 0})
    whole = solved(math.inf, "iterative", ksp_type="cg")
    agree(whole, solved(math.inf, "direct"))
    apply, count = FilteredMultigrid.apply, 0

    def often_indefinite(self: FilteredMultigrid, r: PETSc.Vec, z: PETSc.Vec) -> None:
        nonlocal count
        apply(self, r, z)
        if self.filters:
            count += 1
            z.scale(-1.0 if count % 6 == 0 else 1.0)

    monkeypatch.setattr(FilteredMultigrid, "apply", often_indefinite)
    # If it did not go on, the method would give up, and Newton begin anew.
    often = solved(math.inf, "iterative", ksp_type="cg")
    assert often.summary["iterations"]["tangents"] <= whole.summary["iterations"]["tangents"] + 2
    assert count >= 6


def test_inexact_solves_take_three_tangents_more_at_most_at_n_infinite() -> None:
    exact, inexact = (
        solved(math.inf, linear).summary["iterations"]["tangents"]
        for linear in ("direct", "iterative")
    )
    assert inexact <= exact + 3


def test_the_last_tangents_are_no_harder_for_gmres_than_those_before() -> None:
    # Where equilibrium is nearly reached, what is left is far smaller than the residual of a step
    # like the last, in stiff cells and on nodes that stick.
    def tangents(**options: str) -> int:
        rubbing = block(
            2,
            0.2,
            mesh__structured=True,
            material__locking_limit=0.05,
            loads={"displacements": [{"on": "top", "value": [0.0119456, -0.01077931]}]},
            friction__coefficient=0.65419,
            friction__smoothing__radius=0.3,
            penalty__n=math.inf,
            solver__linear="iterative",
        )
        solution = solving.solve(rubbing, petsc_options=options)
        return int(solution.summary["iterations"]["tangents"])

    # The interior point method alone, in both.
    assert tangents() <= tangents(**FACTORISES) + 3


def test_users_may_factorise_instead() -> None:
    agree(solved(1e4, "iterative", **FACTORISES), solved(1e4, "direct"))


@pytest.mark.slow
def test_users_may_precondition_otherwise() -> None:
    by_gamg = solved(1e2, "iterative", pc_type="gamg", ksp_rtol="1e-10")
    agree(by_gamg, solved(1e2, "direct"))


def test_filtering_what_contact_holds_takes_iterations_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tangent_solver, "_PATIENCE", {3: 0})
    held = solved(math.inf, "iterative").summary["iterations"]["linear"]
    nothing = np.empty(0, dtype=np.int32)
    monkeypatch.setattr(ContactNodes, "stiffer_than", lambda *_: nothing)
    assert 1.5 * held < solved(math.inf, "iterative").summary["iterations"]["linear"]


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
