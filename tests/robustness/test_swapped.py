"""Problems of the sweep with the sides of contact swapped, and what this comparison finds."""

from __future__ import annotations

from typing import Any

import pytest
from mpi4py import MPI
from sweep import swapped
from sweep.case import Study, clamp, study
from sweep.families import case_of
from sweep.solve import SOLVED, outcome_of
from sweep.swapped import AGREES, BY_MESH, Compared, compared, exchanged

from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

pytest.importorskip("clarabel")
pytestmark = pytest.mark.serial


@pytest.mark.parametrize(("seed", "kind"), [(7, AGREES), (5, BY_MESH)])
def test_bodies_have_opposite_forces_with_swapped_sides(seed: int, kind: str) -> None:
    outcome = outcome_of("bodies", seed, checks=True)
    assert (outcome.kind, outcome.notes["swapped"]) == (SOLVED, kind), outcome.reason


def test_grains_under_one_name_have_no_sides_to_swap() -> None:
    assert exchanged(case_of("grains", 0).study) is None


def test_forces_of_other_sides_that_are_a_tenth_larger_are_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def larger(given: Study) -> Study | None:
        other = exchanged(given)
        assert other is not None
        other["loads"]["tractions"] = [{"on": "top", "value": [0.0, -1.1e-3]}]
        return other

    monkeypatch.setattr(swapped, "exchanged", larger)
    loads: dict[str, Any] = {
        "tractions": [{"on": "top", "value": [0.0, -1e-3]}],
        "displacements": [clamp(2, "bottom"), {"on": "upper_left", "value": [0.0, None]}],
    }
    given = study({"builder": "stack", "dim": 2, "h": 0.5}, loads, friction=0.3)
    given["contact"] = {"on": "upper_bottom", "gap": 0.0, "against": "lower_top"}
    problem = assemble(Parameters.model_validate(given), MPI.COMM_SELF)
    found = compared(given, solve_assembled(problem), 0.0)
    assert found is not None and found.complaint
    assert found.difference == pytest.approx(1.0 / 11.0, rel=0.05)


@pytest.mark.parametrize(("difference", "is_right"), [(0.05, True), (0.1, True), (0.11, False)])
def test_the_error_of_the_mesh_is_allowed(difference: float, is_right: bool) -> None:
    assert (not Compared(difference, 0.1).complaint) == is_right
