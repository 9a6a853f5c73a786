"""Reports in headless Chromium: what a reader sees and does, and that nothing leaves the page."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import browser
import pytest
from report_folder import TITLE, rows, run_folder, study_folder

from contact_locking.view import report

pytestmark = [
    pytest.mark.serial,
    pytest.mark.skipif(
        browser.PROGRAM is None, reason=f"none of {', '.join(browser.PROGRAMS)} is on the PATH"
    ),
]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    case = folder / "study" / "cases" / rows()[0]["case"]
    run_folder(case, picture=True)
    study_folder(folder / "study")
    with pytest.MonkeyPatch.context() as patch:
        # The pages show the SVG files; to draw the charts once more as PNG takes as long.
        patch.setattr("matplotlib.figure.Figure.savefig", lambda *given, **options: None)
        return {
            "run": report.write(case)[-1],
            "study": report.write(folder / "study")[-1],
        }


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Browser]:
    with browser.Browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.mark.parametrize("name", ["run", "study"])
@pytest.mark.parametrize(("width", "scheme"), [(360, "light"), (1600, "dark")])
def test_a_page_is_whole_at_any_width_and_asks_for_nothing(
    name: str, width: int, scheme: str, pages: dict[str, Path], tab: browser.Browser
) -> None:
    tab.open(pages[name], width, scheme)
    asked = [url for url in tab.requests if not url.startswith("data:")]
    assert asked == [pages[name].as_uri()]
    assert tab.complaints == []
    # Wide tables scroll inside the page, not the page itself.
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 0)")
    sizes = tab.evaluate("[...document.querySelectorAll('svg')].map(s => s.clientWidth)")
    assert sizes and min(sizes) > 250


def test_what_users_wrote_is_text_and_nothing_else(
    pages: dict[str, Path], tab: browser.Browser
) -> None:
    for page in pages.values():
        tab.open(page)
        assert tab.evaluate("document.title") == TITLE
        assert tab.evaluate("document.querySelector('h1').textContent") == TITLE
        assert tab.evaluate("document.scripts.length") == 1
        assert tab.evaluate("document.querySelectorAll('[onerror]').length") == 0


def test_a_foreign_script_would_not_run(pages: dict[str, Path], tab: browser.Browser) -> None:
    page = pages["run"].with_name("changed.html")
    page.write_text(pages["run"].read_text().replace("</h1>", "</h1><script>foreign = 1</script>"))
    tab.open(page)
    assert tab.evaluate("typeof foreign") == "undefined"
    assert "Content Security Policy" in "".join(tab.complaints)


def column(tab: browser.Browser, name: str) -> Any:
    """The visible contents of a column, from top to bottom."""
    return tab.evaluate(
        f"""(() => {{
            const table = document.getElementById("cases");
            const names = [...table.tHead.rows[0].cells].map(cell => cell.dataset.key);
            return [...table.tBodies[0].rows].filter(row => !row.hidden)
                .map(row => row.cells[names.indexOf({name!r})].textContent);
        }})()"""
    )


def click(tab: browser.Browser, name: str) -> None:
    tab.evaluate(f"document.querySelector('#cases th[data-key={json.dumps(name)}] button').click()")


def type_in(tab: browser.Browser, text: str) -> None:
    tab.evaluate(
        f"(f => {{ f.value = {text!r}; f.dispatchEvent(new Event('input')); }})"
        "(document.getElementById('filter'))"
    )


def test_a_click_sorts_by_number_and_another_one_backwards(
    pages: dict[str, Path], tab: browser.Browser
) -> None:
    tab.open(pages["study"])
    ascending = ["100", "100", "1000", "1000", "10⁴", "10⁴", "∞", "∞"]
    assert sorted(column(tab, "penalty.n")) == sorted(ascending)
    click(tab, "penalty.n")
    assert column(tab, "penalty.n") == ascending
    click(tab, "penalty.n")
    assert column(tab, "penalty.n") == ascending[::-1]
    # The failed case has no value and comes last in both directions.
    for _ in range(2):
        click(tab, "penetration_max")
        assert column(tab, "penetration_max")[-1] == "–"
    click(tab, "state")
    assert column(tab, "state") == ["converged"] * 7 + ["failed"]


def test_the_filter_keeps_rows_with_all_its_words(
    pages: dict[str, Path], tab: browser.Browser
) -> None:
    tab.open(pages["study"])

    type_in(tab, "KILLED  0.2")
    assert column(tab, "state") == ["failed"]
    assert tab.evaluate("document.getElementById('count').textContent") == "1 of 8 cases"
    type_in(tab, "")
    assert len(column(tab, "state")) == 8
