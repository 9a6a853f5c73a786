"""The affine displacements below the quadratic ones, on which multigrid goes on."""

from __future__ import annotations

import numpy as np
import pytest
from problems import block
from turned_supports import pressed, turn, turned

from contact_locking.parallel import maximum
from contact_locking.problem.system import PenalisedSystem
from contact_locking.process import solving
from contact_locking.process.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters
from contact_locking.supports.affine_part import affine_part


@pytest.mark.parametrize("dim", [2, 3])
def test_affine_fields_that_keep_the_conditions_become_themselves_and_others_keep_them(
    dim: int,
) -> None:
    rotation = turn(dim)
    # The conditions hold no direction of an axis.
    problem = turned(pressed(dim, rotation, "normal", discretisation__degree=2), rotation)
    space = problem.u.function_space
    prolongation, motions = affine_part(space, problem.constraints)
    coarse, fine = prolongation.createVecs()
    count = fine.getLocalSize() // dim
    corners = np.unique(space.dofmap.list[:, : dim + 1])
    corners = corners[corners < count]
    # The coordinates before the rotation: the rollers are at 0, all but along the last axis.
    x = space.tabulate_dof_coordinates()[:count, :dim] @ rotation
    field = x * np.arange(1, dim + 1)
    field[:, -1] = 1.0 + x.sum(axis=1)
    field = field @ rotation.T
    assert np.abs(problem.constraints.held_part(field.reshape(-1))).max() < 1e-14
    coarse.array_w[:] = field[corners].reshape(-1)
    prolongation.mult(coarse, fine)
    np.testing.assert_allclose(fine.array_r.reshape(-1, dim), field, atol=1e-14)
    coarse.array_w[:] = np.random.default_rng(1).standard_normal(coarse.getLocalSize())
    prolongation.mult(coarse, fine)
    held = problem.constraints.held_part(np.array(fine.array_r)).reshape(-1, dim)
    assert maximum(space.mesh.comm, np.abs(held[corners])) > 0.1
    held[corners] = 0.0
    assert np.abs(held).max() < 1e-14
    for item in (prolongation, motions, coarse, fine):
        item.destroy()


def _iterations(parameters: Parameters, is_turned: bool = False) -> int:
    if is_turned:
        solution = solve_assembled(turned(parameters, turn(2)))
    else:
        solution = solving.solve(parameters)
    assert solution.converged, solution.summary["reason"]
    return int(solution.summary["iterations"]["linear"])


def test_affine_fields_below_take_iterations_away(monkeypatch: pytest.MonkeyPatch) -> None:
    # A small n leaves the filter nothing to do, and any smoother gains.
    given = block(2, 1 / 8, mesh__structured=True, penalty__n=1.0,
                  discretisation__degree=2, solver__linear="iterative")  # fmt: skip
    below = _iterations(given)
    monkeypatch.setattr(PenalisedSystem, "coarser_spaces", lambda _: [])
    assert 1.4 * below < _iterations(given)


def test_conditions_along_any_direction_take_the_same_iterations() -> None:
    changes = {"discretisation__degree": 2, "solver__linear": "iterative"}
    straight = _iterations(pressed(2, np.eye(2), "component", **changes))
    oblique = _iterations(pressed(2, turn(2), "direction", **changes), is_turned=True)
    assert abs(oblique - straight) <= 0.2 * straight
