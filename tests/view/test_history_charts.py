"""Charts of the history: of each contact, and of any columns over others, with units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from problems import seal

from contact_locking import InputError, solve
from contact_locking.results.output import UnitLabels
from contact_locking.results.table import Table
from contact_locking.running.run import run
from contact_locking.study_file import from_mapping
from contact_locking.view import report
from contact_locking.view.report.run_charts import Process, charts_of, column_of

pytestmark = pytest.mark.serial

HISTORY = Table.of(
    [
        {"step": k, "t": 0.5 * k, "contact_force_plate_y": -2.0 * k, "motion_plate_y": -k}
        for k in (1, 2)
    ]
)
CURVE = {"x": "-motion_plate_y", "y": "-contact_force_plate_y"}


@pytest.mark.parametrize(
    ("name", "title", "unit"),
    [
        ("contact_force_plate_y", "contact force on plate, y", "force"),
        ("contact_force_y", "contact force, y", "force"),
        ("contact_area_plate", "contact area on plate", "area"),
        ("contact_area_x", "contact area on x", "area"),
        ("motion_plate_y", "motion of plate, y", "length"),
        ("reaction_x", "reaction on x", "force"),
        ("tool_travel_left_pad", "travel of left_pad", "length"),
        ("dissipated_total", "dissipated total", "energy"),
        ("t", "t", "time"),
        ("tangents", "tangents", ""),
    ],
)
def test_a_column_is_told_with_its_contact_and_its_unit(name: str, title: str, unit: str) -> None:
    column = column_of(name, ["plate", "x"])
    assert (column.title, column.unit) == (title, unit)


def test_values_are_those_of_columns_and_of_expressions_of_columns() -> None:
    np.testing.assert_array_equal(HISTORY.values("motion_plate_y"), [-1.0, -2.0])
    np.testing.assert_array_equal(HISTORY.values("1.2*t + step"), [1.6, 3.2])
    np.testing.assert_array_equal(HISTORY.values("3"), [3.0, 3.0])


def test_a_chart_has_a_curve_for_each_case_and_a_wrong_column_is_named() -> None:
    cases = [Process(HISTORY, f"mu = {mu}") for mu in (0.1, 0.3)]
    (drawn,) = charts_of([CURVE], cases, ["plate"], {"force": "N/mm", "length": "mm"})
    assert drawn.description == "-contact_force_plate_y over -motion_plate_y"
    assert charts_of([CURVE], [Process(Table.of(HISTORY.rows[:1]))], [], {}) == []
    with pytest.raises(InputError) as caught:
        charts_of([{"x": "t", "y": "contact_force_top_y"}], cases, ["plate"], {})
    assert caught.value.key == "output.charts.0.y"


@pytest.mark.parametrize(
    ("given", "is_plane", "expected"),
    [
        ({}, True, {"force": "N/mm", "stress": "N/mm²", "area": "mm", "energy": "N"}),
        ({"stress": "MPa"}, False, {"force": "N", "stress": "MPa", "area": "mm²"}),
        ({"time": "s"}, False, {"time": "s", "energy": "N·mm", "force · length": "N·mm"}),
    ],
)
def test_labels_of_units_follow_from_those_of_length_and_force(
    given: dict[str, str], is_plane: bool, expected: dict[str, str]
) -> None:
    labels = UnitLabels(length="mm", force="N", **given).labels(is_plane)
    assert labels.items() >= expected.items()


def test_charts_need_steps_and_their_columns_are_checked_after_the_first() -> None:
    with pytest.raises(InputError):
        from_mapping({"output": {"charts": [CURVE]}})
    charts = [CURVE, {"x": "t", "y": "contact_force_top_y"}]
    with pytest.raises(InputError) as caught:
        solve(seal(output={"charts": charts}))
    assert caught.value.key == "output.charts.1.y"


@pytest.mark.usefixtures("unrendered")
def test_a_run_of_two_contacts_has_their_charts(tmp_path: Path) -> None:
    output = {
        "picture": False,
        "fields": False,
        "units": {"length": "mm", "force": "N"},
        "charts": [CURVE],
    }
    run(seal(output=output), tmp_path)
    report.write(tmp_path)
    charts = {path.stem for path in (tmp_path / "report").glob("*.svg")}
    assert {"history-contact-force", "history-friction-force", "history-share"} <= charts
    assert any(name.startswith("chart-0-") for name in charts)
