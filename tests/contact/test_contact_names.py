"""Several contacts: their names, and one table of their points in memory and in contact.csv."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from problems import seal, two_bodies
from solutions import of_kind

from contact_locking import Contact, from_mapping, solve
from contact_locking.arrays import IntArray
from contact_locking.contact.contact import named
from contact_locking.errors import InputError
from contact_locking.results.contact_points import ContactPoints
from contact_locking.results.in_words import rows
from contact_locking.results.quantities import look_up
from contact_locking.results.table import Table
from contact_locking.running.run import facets_table

pytestmark = pytest.mark.serial


def test_a_contact_without_a_name_has_that_of_its_first_part_and_no_two_have_the_same() -> None:
    given = [
        ("grains", None),
        ("grains", "wall"),
        ("grains", None),
        ("a.b", None),
        ("grains", "grains_2"),
    ]
    found = named([Contact([part], name=name) for part, name in given])
    assert [one.name for one in found] == ["grains", "wall", "grains_3", "a_b", "grains_2"]


def test_the_forces_of_two_foundations_stand_by_their_names() -> None:
    """Plate and groove press against each other, so that their sum says nothing."""
    kinds = ("contacts.plate", "contacts.1", "contacts.bottom")
    of = [*(f"{kind}.contact_force.1" for kind in kinds), "contact_force.1"]
    to = ["material.elasticity.young"]
    found = solve(seal(sensitivities={"of": of, "to": to}))
    groove, plate = (found.summary["contacts"][number]["contact_force"][1] for number in (0, 1))
    rubbed = found.summary["friction_force"][1]
    assert groove + rubbed == pytest.approx(-plate, rel=1e-5) and plate < -5.0
    assert look_up(found.summary, of[0]) == plate == look_up(found.summary, of[1])
    assert found.summary["contact_force"][1] == pytest.approx(plate + groove)
    row = found.history.rows[-1]
    assert row["contact_force_plate_y"] == plate and row["contact_force_bottom_y"] == groove
    np.testing.assert_allclose(found.history.column("motion_plate_y"), [-0.4, -0.8])
    (force,) = (words for name, words in rows(found.summary) if name == "contact force")
    assert force.endswith(f"{plate:.4g}) on plate") and f"{groove:.4g}) on bottom" in force
    one, same, other, total = (
        found.summary["sensitivities"][name][to[0]]["derivative"] for name in of
    )
    assert one == same < 0.0 and total == pytest.approx(one + other, rel=1e-6)


@pytest.mark.parametrize(
    ("on", "against"), [("upper_bottom", "lower_top"), ("lower_top", "upper_bottom")]
)
def test_no_sum_counts_the_force_between_two_bodies(on: str, against: str) -> None:
    """Either side may be on: the sum is the force of the floor, which the support balances."""
    summary = solve(two_bodies(on, against), MPI.COMM_WORLD).summary
    floor, between = (
        np.add(entry["contact_force"], entry["friction_force"]) for entry in summary["contacts"]
    )
    assert [entry["name"] for entry in summary["contacts"]] == ["bottom", on]
    assert summary["contact_force"] == summary["contacts"][0]["contact_force"]
    assert floor[1] > 5.0
    assert abs(between[1]) == pytest.approx(floor[1], rel=1e-5)
    assert floor[1] == pytest.approx(-summary["reactions"]["top"][1], rel=1e-5)


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


def test_the_name_of_another_contact_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        named([Contact(part, name="x", at=f"contacts.{n}") for n, part in enumerate("ab")])
    assert caught.value.key == "contacts.1"
    with pytest.raises(InputError, match=r"^contact\.1\.name: "):
        from_mapping({"contact": [{"on": "bottom", "name": "x"}, {"on": "left", "name": "x"}]})
