"""Steps of the friction bound: what the predictor foresees saves back-substitutions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from problems import block

from contact_locking import study_file
from contact_locking.errors import NotConverged
from contact_locking.process import solving
from contact_locking.results.solution import StudySolution
from contact_locking.solver.interior_point import method
from contact_locking.solver.interior_point.bound_step import BoundStep
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.task import LastIterate
from contact_locking.study_file.parameters import Parameters


def _solved(
    monkeypatch: pytest.MonkeyPatch, coefficient: float, foreseen_above: float
) -> tuple[StudySolution, int]:
    """The block with this friction, and how many responses to a step of the bound it took."""
    count = 0
    learn = BoundStep._learn

    def counting(self: BoundStep, *given: object) -> None:
        nonlocal count
        count += 1
        learn(self, *given)  # type: ignore[arg-type]

    with monkeypatch.context() as changed:
        changed.setattr(BoundStep, "_learn", counting)
        # Of the cones alone, without the last tangents on the pieces of the laws.
        changed.setattr(method.InteriorPoint, "finish", lambda _, found: found)
        changed.setattr(method, "Tuning", lambda: Tuning(foreseen_above=foreseen_above))
        changes = {"mesh__structured": True, "penalty__n": math.inf, "solver__linear": "direct"}
        solution = solving.solve(block(2, 1 / 24, friction__coefficient=coefficient, **changes))
    assert solution.converged
    return solution, count


def test_a_foreseen_step_of_the_bound_saves_half_of_the_responses(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    foreseen, few = _solved(monkeypatch, 0.3, Tuning().foreseen_above)
    unforeseen, many = _solved(monkeypatch, 0.3, math.inf)
    assert few <= 0.5 * many
    tangents = [item.summary["iterations"]["tangents"] for item in (foreseen, unforeseen)]
    assert tangents[0] <= tangents[1] + 1
    for key in ("compliance", "elastic_energy"):
        assert foreseen.summary[key] == pytest.approx(unforeseen.summary[key], rel=2e-7)


def test_the_end_of_a_solve_foresees_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the corrector keeps the duality gap, and the predictor leads elsewhere."""
    seen: list[float] = []
    foresee = BoundStep.foresee

    def noting(self: BoundStep, *given: object) -> None:
        seen.append(1.0)
        foresee(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(BoundStep, "foresee", noting)
    solution, _ = _solved(monkeypatch, 0.3, Tuning().foreseen_above)
    assert 0 < len(seen) < solution.summary["iterations"]["tangents"] - 2


# Rounding differs with the ranks, and may send the first approach on this verge another way.
@pytest.mark.serial
@pytest.mark.parametrize("n", [2500.0, 7500.0])
def test_short_steps_set_the_bound_where_it_is_nearly_right(
    n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If they kept it, they would vanish with the bound at 1e-7 of what it should be."""
    failures: list[NotConverged] = []
    solve = method.InteriorPoint.solve

    def noting(self: method.InteriorPoint, last: LastIterate | None, *more: Any) -> object:
        try:
            return solve(self, last, *more)
        except NotConverged as failure:
            failures.append(failure)
            raise

    monkeypatch.setattr(method.InteriorPoint, "solve", noting)
    wedged = study_file.load(
        Path(__file__).parents[1] / "robustness/wedged/verge_10026.yml"
    ).parameters
    data = wedged.model_dump()
    data["penalty"].update(n=n, epsilon=1.0 / n)
    data["friction"]["regularisation"] = 1.0 / n
    assert solving.solve(Parameters.model_validate(data)).converged
    assert not failures
