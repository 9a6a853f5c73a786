"""The points of several contacts: one table in memory and in contact.csv."""

from __future__ import annotations

import math

import numpy as np
import pytest
from problems import block
from solutions import of_kind

from contact_locking import solve
from contact_locking.arrays import IntArray
from contact_locking.results.contact_points import ContactPoints, facets_table
from contact_locking.results.table import Table

pytestmark = pytest.mark.serial


def table(dim: int, kind: str = "with two contacts") -> tuple[ContactPoints, IntArray]:
    solution = of_kind(dim, kind)
    assert solution.contact_points is not None and solution.contact_facets is not None
    return solution.contact_points, solution.contact_facets


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kind", ["locked", "without contact", "with two contacts"])
def test_contact_csv_is_read_as_it_was_written(dim: int, kind: str) -> None:
    points, facets = table(dim, kind)
    found = ContactPoints.of(Table.read(points.table.text(), "contact.csv", ["state"]))
    for column, values in vars(points).items():
        read = getattr(found, column)
        assert read.dtype == values.dtype and np.array_equal(read, values), column
    numbers = Table.read(facets_table(facets).text(), "contact_facets.csv").columns.values()
    assert np.array_equal(np.column_stack([*numbers]), facets)


def test_a_solve_of_two_contacts_has_the_points_of_both_in_the_order_of_the_study_file() -> None:
    contacts = [{"on": "left"}, {"on": "bottom", "friction": {"coefficient": 0.1}}]
    push = [{"on": "top", "value": [0.0, -0.05]}, {"on": "right", "value": [-0.03, 0.0]}]
    loads = {"tractions": push, "displacements": []}
    solution = solve(block(h=0.25, contact=contacts, loads=loads, penalty__n=math.inf))
    assert solution.converged
    points, summary = solution.contact_points, solution.summary
    assert points is not None
    left, bottom = points.parts()
    assert np.abs(left.x[:, 0]).max() < 1e-12 and np.abs(bottom.x[:, 1]).max() < 1e-12
    assert [one["name"] for one in summary["contacts"]] == ["left", "bottom"]
    assert [np.argmax(np.abs(one["contact_force"])) for one in summary["contacts"]] == [0, 1]
    # The radius of R is the distance of the nodes, which leaves the pressure as it is.
    assert left.bound == pytest.approx(0.3 * left.pressure, rel=1e-6)
    assert bottom.bound == pytest.approx(0.1 * bottom.pressure, rel=1e-6)
