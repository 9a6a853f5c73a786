"""Reports of a study: every case, the values that vary, rates, charts and pictures."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_folder import REASON, page, quick, rows, run_folder, study_folder

from contact_locking.view import report
from contact_locking.view.report.trends import Differences
from contact_locking.view.report.words import titles_in

pytestmark = pytest.mark.serial


LOADS = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
study: {vary: {loads.tractions: [[], [{on: top, value: [0, 1]}]], penalty.n: [1.0e2, 1.0e3, .inf]}}
"""


@quick
def test_a_report_of_a_study_has_every_case_and_the_reasons(tmp_path: Path) -> None:
    text = page(study_folder(tmp_path))
    assert "7 of 8 cases converged" in text and "1 failed" in text
    assert text.count('<tr id="case-') == 8
    # A line separator inside a reason must not cut its row in two.
    assert "was &lt;img src=x onerror=alert(1)&gt; killed by SIGKILL\u2028perhaps" in text
    assert REASON not in text
    assert 'data-value="Infinity"' in text


def test_cases_whose_loads_are_lists_are_told_apart_in_every_part_of_a_page(tmp_path: Path) -> None:
    push, loads = {"on": "right", "value": [0, 1]}, "loads.tractions"
    values = [[{"on": "top", "value": [0, -load]}, push] for load in (1, 2, 3)]
    table = [row | {loads: value} for value in values for row in rows()[:4]]
    for number, row in enumerate(table):
        row["case"] = f"{number:016x}"
    text = page(study_folder(tmp_path, table, LOADS))
    for load in (1, 2, 3):
        told = f"[{{on: top, value: [0, −{load}]}}, …]"
        assert text.count(f'<span class="parts">{told}</span>') == 4
        assert f"tractions = {told}" in "".join(
            chart.read_text() for chart in (tmp_path / "report").glob("*over-penalty.n.svg")
        )
    assert "&#34;on&#34;" not in text and "on: right" not in text.partition("<h2>Parameters")[0]


def test_a_short_geometric_range_has_its_own_values_as_marks(tmp_path: Path) -> None:
    table = rows()[:3]
    for row, n in zip(table, (1.0, 2.0, 4.0), strict=True):
        row["penalty.n"] = n
        row["contact_force.0"] = 3.0 + 1.0 / n
    page(study_folder(tmp_path, table))
    drawing = (tmp_path / "report" / "contact_force-over-penalty.n.svg").read_text()
    # Matplotlib writes texts as paths, with each text as a comment.
    texts = re.findall("<!-- (.*) -->", drawing)
    assert {"1", "2", "4"} <= set(texts) and not any("times" in text for text in texts)


def test_rates_are_those_of_the_numbers(tmp_path: Path) -> None:
    folder = study_folder(tmp_path)
    report.write(folder)
    names = {path.stem for path in (folder / "report").iterdir()}
    force, error = "contact_force-over-penalty.n", "penetration_max-over-penalty.n"
    assert {force, f"{force}-rate", f"{error}-rate"} <= names
    # A quantity with the limit 0 needs no second chart of its distance from the limit.
    assert error not in names
    n = np.array([1e2, 1e3, 1e4, 1e5])
    law: Any = 3.0 / n**1.5
    exact = Differences("", n, law, floor=0.0)
    assert exact.power_law() == pytest.approx((-1.5, 3.0))
    # Below the tolerance there is no rate to see, and none in what jumps.
    floored = Differences("", n, law, floor=1e-4)
    assert floored.power_law() is None
    assert Differences("", n, np.array([1.0, 0.1, 1.0, 0.1]), floor=0.0).power_law() is None


@quick
def test_a_study_without_numbers_to_plot_still_has_its_table(tmp_path: Path) -> None:
    table = rows()[:2]
    for row, state in zip(table, ("failed", "not run"), strict=True):
        row |= {"state": state, "converged": False}
    text = page(study_folder(tmp_path, table))
    assert "0 of 2 cases converged, unfinished" in text
    assert "too few cases have converged" in text


@quick
def test_pictures_of_the_cases_are_inside_the_page(tmp_path: Path) -> None:
    case = study_folder(tmp_path / "study") / "cases" / rows()[0]["case"]
    run_folder(case, picture=True)
    text = page(tmp_path / "study")
    assert f'href="#picture-{case.name}"' in text and f'id="picture-{case.name}"' in text
    assert text.count("data:image/png") == 1
    (case / "picture.png").write_bytes(b"\x89PNG no more")
    assert "data:image/png" not in page(tmp_path / "study")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize("key", ["penalty.n", "penetration_max"])
def test_charts_of_extreme_numbers_are_drawn(key: str, tmp_path: Path) -> None:
    table = rows()
    for row, value in zip(table, (1e-300, 1e300, 0.0, -1e300, 1e-320), strict=False):
        row[key] = value
    assert "<svg" in page(study_folder(tmp_path, table))


@quick
def test_what_rounding_changes_is_neither_drawn_nor_a_column(tmp_path: Path) -> None:
    table = rows()
    for number, row in enumerate(table):
        row |= {"elastic_energy": 0.15 * (1.0 + 1e-11 * number), "slip_area": 0.0}
        row |= {"compliance": 1.0 + number, "iterations.tangents": 10 + number}
    text = page(study_folder(tmp_path, table))
    drawn = {path.stem.partition("-over-")[0] for path in (tmp_path / "report").glob("*.svg")}
    assert {"compliance", "penetration_max", "iterations.tangents"} <= drawn
    assert not {"elastic_energy", "slip_area"} & drawn
    columns = re.findall(r'<th scope="col"([^>]*)data-key="([^"]+)"', text)
    shown = {key for kind, key in columns if "more" not in kind}
    assert "compliance" in shown
    assert not {"elastic_energy", "slip_area", "iterations.tangents"} & shown
    assert text.index("The work of the solver") > text.index("Over the")


def test_keys_in_lists_are_named_by_the_boundary_part_and_the_axis() -> None:
    data = {
        "loads": {
            "tractions": [{"on": ["top"], "value": [0, -1]}],
            "displacements": [{"on": ["left", "right"], "value": [0, 0]}],
            "body_force": [0, 1],
        },
        "contact": [{"on": ["bottom"], "friction": {"coefficient": 0.1}}],
    }
    named = {
        "loads.tractions.0.value.1": "traction on top, y",
        "loads.tractions.0.value": "traction on top",
        "loads.displacements.0.value.0": "displacement on left, right, x",
        "loads.body_force.1": "body force, y",
        "contact.0.friction.coefficient": "contact friction coefficient on bottom",
        "friction.coefficient": "friction coefficient μ",
    }
    assert titles_in(list(named), data) == named
