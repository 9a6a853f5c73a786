"""Solutions that follow the penalty from soft to stiff; tests/robustness has those that grow."""

from __future__ import annotations

from pathlib import Path

import pytest
from mpi4py import MPI
from problems import solved
from sweep.case import Case
from sweep.solve import SOLVED, outcome_of_case

from contact_locking import study_file
from contact_locking.study_file.dump import plain

_WEDGED = Path(__file__).parents[1] / "robustness" / "wedged" / "curved_overlap.yml"

pytestmark = pytest.mark.serial


@pytest.mark.slow
def test_bounds_that_settle_lead_to_the_solution_without_a_penalty() -> None:
    """The branch over the share of friction took 3600 tangents for it."""
    parameters = study_file.load(Path(__file__).with_name("huge_load.yml")).parameters
    solution = solved(parameters, MPI.COMM_SELF)
    assert solution.summary["iterations"]["tangents"] <= 1000


def test_a_finite_penalty_has_the_solution_that_softer_ones_lead_to() -> None:
    data = plain(study_file.load(_WEDGED, ["penalty.n=1e4"]).parameters)
    outcome = outcome_of_case(Case(data), checks=False)
    assert outcome.kind == SOLVED, outcome.reason
