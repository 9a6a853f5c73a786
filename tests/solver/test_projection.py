"""What is too large for the filter is projected: CG bears any contrast, and quadratic elements."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from petsc4py import PETSc
from problems import block
from slow import slow
from solved_by_cg import agree, solved

from contact_locking.process import solving
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.linear import tangent_solver
from contact_locking.solver.linear.factorised import FILTER_LIMIT
from contact_locking.solver.linear.filtered_multigrid import Projection
from contact_locking.solver.linear.gmres import Gmres
from contact_locking.solver.linear.multigrid import Multigrid
from contact_locking.solver.linear.tangent_solver import Assemble, MultigridTangents


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


@pytest.mark.parametrize(("n", "projects"), [(1e4, False), (math.inf, True)])
def test_multigrid_alone_may_take_longer_where_n_bounds_the_contrast(
    monkeypatch: pytest.MonkeyPatch, n: float, projects: bool
) -> None:
    monkeypatch.setattr(tangent_solver, "_PATIENCE_OF_PROJECTION", 0)
    monkeypatch.setitem(FILTER_LIMIT, (3, 1), 0)
    made = _count_rows(monkeypatch)
    assert solved(n, "iterative").converged
    assert bool(made) == projects


@pytest.mark.slow
def test_multigrid_smooths_more_before_the_projection_takes_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Any number of iterations announces that the next tangent may take too many.
    monkeypatch.setattr(tangent_solver, "_NEARLY_IMPATIENT", 0.0)
    monkeypatch.setattr(tangent_solver, "_PATIENCE_OF_PROJECTION", 200)
    monkeypatch.setitem(FILTER_LIMIT, (3, 1), 0)
    made = _count_rows(monkeypatch)
    projections_before: list[int] = []
    smooth_more = Multigrid.smooth_more

    def noting(self: Multigrid) -> None:
        projections_before.append(len(made))
        smooth_more(self)
        levels = self._pc.getMGLevels()
        steps = [self._pc.getMGSmoother(i).getTolerances()[3] for i in range(1, levels)]
        assert set(steps) == {4}

    monkeypatch.setattr(Multigrid, "smooth_more", noting)
    projected = solved(math.inf, "iterative")
    # One tangent with more steps, and after that the projection.
    assert projections_before == [0]
    assert made
    agree(projected, solved(math.inf, "direct"))


def test_the_projection_stays_once_it_has_taken_over(monkeypatch: pytest.MonkeyPatch) -> None:
    # The first solve that takes more than one iteration is ended by the projection.
    monkeypatch.setattr(tangent_solver, "_PATIENCE_OF_PROJECTION", 1)
    monkeypatch.setitem(FILTER_LIMIT, (3, 1), 0)
    made = _count_rows(monkeypatch)
    monkeypatch.setattr(Multigrid, "smooth_more", lambda _: pytest.fail("multigrid alone again"))
    found = solved(math.inf, "iterative")
    assert found.converged
    # All but the first tangents, in which nothing is stiff.
    assert len(made) >= found.summary["iterations"]["tangents"] - 2


def test_a_projected_tangent_is_multiplied_by_its_parts_and_not_assembled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _project_everything(monkeypatch, 3)
    whole: list[PETSc.Mat] = []
    counts: dict[bool, list[int]] = {False: [], True: []}
    refresh_solver, refresh = MultigridTangents.refresh, Tangent.refresh

    def refresh_unassembled(self: MultigridTangents, assemble: Assemble, *given: Any) -> None:
        made: list[PETSc.Mat] = []
        assemble(self._matrix)
        whole.append(self._matrix.copy())
        # A solver that does not assemble its matrix must not read it.
        self._matrix.zeroEntries()

        def assemble_and_note(matrix: PETSc.Mat) -> None:
            assemble(matrix)
            made.append(matrix)

        refresh_solver(self, assemble_and_note, *given)
        counts[self.filters].append(len(made))

    def compared(self: Tangent) -> None:
        refresh(self)
        x, expected = whole[-1].createVecs()
        found = expected.duplicate()
        anything = np.random.default_rng(1).standard_normal(x.getLocalSize())
        x.array_w[:] = self.system.constraints.free_part(anything)
        whole[-1].mult(x, expected)
        self._linear.multiply(x, found)
        found.axpy(-1.0, expected)
        assert found.norm() <= 1e-12 * expected.norm()
        for item in (whole.pop(), x, expected, found):
            item.destroy()

    monkeypatch.setattr(MultigridTangents, "refresh", refresh_unassembled)
    monkeypatch.setattr(Tangent, "refresh", compared)
    solved(math.inf, "iterative")
    assert set(counts[False]) == {1}
    assert len(counts[True]) > 5 and set(counts[True]) == {0}


def test_a_support_along_an_oblique_direction_is_projected_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The friction bound does not see what a solve leaves along the support, times 1e15."""
    _project_everything(monkeypatch, 2)
    pressed = {"point": [0.0, 0.0261], "normal": [0.0, -1.0]}
    solution = solving.solve(
        block(
            2,
            0.00602133333333,
            mesh__size=[0.036128, 0.0261],
            mesh__structured=True,
            material={"elasticity": {"young": 1e6, "poisson": 0.45}, "locking_limit": math.inf},
            loads={"supports": [{"on": "left", "along": [1.0, 0.33155], "value": 0.0}]},
            contact=[
                {"on": "bottom", "gap": 0.0},
                {"on": "top", "foundation": {"half_space": pressed, "motion": [-4.6e-7, -2.76e-6]}},
            ],
            friction={"coefficient": 0.8, "smoothing": {"kernel": "helmholtz", "radius": 0.006}},
            penalty__n=math.inf,
            solver__linear="iterative",
        )
    )
    assert solution.converged, solution.summary["reason"]


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
