"""Steps of the friction bound, where a short one would leave it nearly right."""

from __future__ import annotations

from pathlib import Path

import pytest

from contact_locking import study_file
from contact_locking.errors import NotConverged
from contact_locking.process import solving
from contact_locking.solver.interior_point import method
from contact_locking.study_file.parameters import Parameters


# Rounding differs with the ranks, and may send the first approach on this verge another way.
@pytest.mark.serial
@pytest.mark.parametrize("n", [2500.0, 7500.0])
def test_short_steps_set_the_bound_where_it_is_nearly_right(
    n: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If they kept it, they would vanish with the bound at 1e-7 of what it should be."""
    failures: list[NotConverged] = []
    solve = method.InteriorPoint.solve

    def noting(self: method.InteriorPoint) -> object:
        try:
            return solve(self)
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
