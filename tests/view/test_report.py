"""Reports of a run: what they say, and which files they replace and leave alone."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure
from report_folder import page, quick, run_folder

from contact_locking.results import folder as result_files
from contact_locking.view import report
from contact_locking.view.report.page import environment

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


def test_a_report_of_a_body_in_three_dimensions_has_maps(tmp_path: Path) -> None:
    text = page(run_folder(tmp_path, dim=3))
    names = {path.stem for path in (tmp_path / "report").iterdir()}
    assert names == {"pressure", "friction", "states"}
    assert "from the foundation" in text


@pytest.mark.parametrize("dim", [2, 3])
def test_axes_of_contact_quantities_have_the_labels_of_their_units(
    dim: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = set[str]()

    def rendered(figure: Figure) -> tuple[str, bytes]:
        seen.update(*((axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes))
        return '<svg viewBox=""></svg>', b""

    monkeypatch.setattr("contact_locking.view.report.page._rendered", rendered)
    page(run_folder(tmp_path, dim=dim))
    endings = {"": 2, "mm": 2, "MPa": 1} if dim == 2 else {"mm": 2, "MPa": 2, "": 1}
    assert Counter(label.partition(" [")[2].rstrip("]") for label in seen) == endings


@quick
def test_a_body_without_contact_has_a_report_too(tmp_path: Path) -> None:
    assert "no contact boundary" in page(run_folder(tmp_path, kind="without contact"))


@quick
def test_a_run_that_did_not_converge_says_why_first(own_run: Path) -> None:
    reason, way_out = "infeasible: no field < M near (1, 2)", "Lower them."
    summary = own_run / "summary.json"
    change(summary, converged=False, reason=reason, suggestion=way_out)
    text = page(own_run)
    verdict = r'<div class="verdict bad">\s*<strong>Infeasible on this mesh</strong>'
    assert re.search(rf"<h1>.*</h1>\s*{verdict}", text)
    assert "no field &lt; M near (1, 2)" in text and way_out in text
    change(summary, reason="too many steps")
    assert "<strong>Not converged</strong>" in page(own_run)


@quick
def test_the_report_of_an_earlier_run_goes_with_its_results(tmp_path: Path) -> None:
    run_folder(tmp_path)
    report.write(tmp_path)
    run_folder(tmp_path)
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        *(result_files.SUMMARY, result_files.PARAMETERS, result_files.CONTACT, result_files.FACETS)
    }


@quick
def test_a_folder_of_the_same_name_keeps_its_other_files(tmp_path: Path) -> None:
    run_folder(tmp_path)
    own = tmp_path / "report" / "thesis.tex"
    own.parent.mkdir()
    own.touch()
    report.write(tmp_path)
    run_folder(tmp_path)
    assert own.exists() and not (tmp_path / "report.html").exists()
