"""Reports in headless Chromium: what a reader sees, and that nothing leaves the page."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

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
        assert tab.evaluate("document.scripts.length") == 0
        assert tab.evaluate("document.querySelectorAll('[onerror]').length") == 0


def test_a_foreign_script_would_not_run(pages: dict[str, Path], tab: browser.Browser) -> None:
    page = pages["run"].with_name("changed.html")
    page.write_text(pages["run"].read_text().replace("</h1>", "</h1><script>foreign = 1</script>"))
    tab.open(page)
    assert tab.evaluate("typeof foreign") == "undefined"
    assert "Content Security Policy" in "".join(tab.complaints)
