"""Reports of a run: what they say, and which files they replace and leave alone."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from report_folder import REASON, page, quick, rows, run_folder, study_folder

from contact_locking.errors import Infeasible, NotConverged
from contact_locking.view import report
from contact_locking.view.report.page import environment
from contact_locking.view.report.trends import Differences

pytestmark = pytest.mark.serial


def change(file: Path, **entries: Any) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | entries))


def test_every_text_is_escaped_by_the_templates_and_their_filters() -> None:
    def rendered(source: str, text: str) -> str:
        return environment().from_string(source).render(text=text)

    assert rendered('<p class="{{ text }}">{{ text }}</p>', '"<') == (
        '<p class="&#34;&lt;">&#34;&lt;</p>'
    )
    assert rendered("{{ text | formula }}", "<Γ_C>") == "&lt;Γ<sub>C</sub>&gt;"
    assert rendered("{{ text | key }}", "a.<b>") == "<code>a.<wbr>&lt;b&gt;</code>"
    assert rendered("{{ text | shown }}", "<i>") == "&lt;i&gt;"


def test_a_report_of_a_run_says_what_came_out(own_run: Path) -> None:
    text = page(own_run)
    verdict = text.index("<strong>Converged</strong>")
    assert verdict < text.index("<h2>Picture</h2>") < text.index("<h2>Key numbers</h2>")
    for word in (
        '<span title="contact_force">contact force</span>',
        "1\u2009234",
        "(0, 0.125)",
        "✓ holds",
    ):
        assert word in text, word
    # The bound was infinite, which JSON cannot hold, and so was n.
    assert text.count("∞") >= 2
    assert "R hardly &lt;i&gt;smooths" in text
    assert "builder: block" in text
    assert {path.name for path in (own_run / "report").iterdir()} == {
        *("tractions.svg", "tractions.png", "slip.svg", "slip.png")
    }
    for path in (own_run / "report").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_a_report_of_a_body_in_three_dimensions_has_its_points(tmp_path: Path) -> None:
    text = page(run_folder(tmp_path, dim=3))
    assert "On the contact boundary" in text and not [*(tmp_path / "report").iterdir()]


@quick
def test_a_run_that_did_not_converge_says_why_first(own_run: Path) -> None:
    reason, way_out = "infeasible: no field < M near (1, 2)", "Lower them."
    summary = own_run / "summary.json"
    change(summary, converged=False, failure=Infeasible.code, reason=reason, suggestion=way_out)
    text = page(own_run)
    verdict = r'<div class="verdict bad">\s*<strong>Infeasible on this mesh</strong>'
    assert re.search(rf"<h1>.*</h1>\s*{verdict}", text)
    assert "no field &lt; M near (1, 2)" in text and way_out in text
    change(summary, failure=NotConverged.code)
    assert "<strong>Not converged</strong>" in page(own_run)


@quick
def test_a_report_of_a_study_has_every_case_and_the_reasons(tmp_path: Path) -> None:
    text = page(study_folder(tmp_path))
    assert "7 of 8 cases converged" in text and "1 failed" in text
    assert text.count('<tr id="case-') == 8
    # A line separator inside a reason must not cut its row in two.
    assert "was &lt;img src=x onerror=alert(1)&gt; killed by SIGKILL\u2028perhaps" in text
    assert REASON not in text


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
def test_a_body_without_contact_has_a_report_too(tmp_path: Path) -> None:
    assert "no contact boundary" in page(run_folder(tmp_path, kind="without contact"))
