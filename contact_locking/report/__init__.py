"""Reports: a page and charts from the files of a finished run or study, without DOLFINx."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.errors import InputError, explained
from contact_locking.results.atomic import put_in_place, remove_abandoned, staging, write_text

if TYPE_CHECKING:
    from .charts import Chart

PAGE, CHARTS = "report.html", "report"

#: What the page says of itself.
GENERATOR = "contact_locking"

_CHART_ENDINGS = (".svg", ".png")
_HEAD_CHARACTERS = 1000


def write(directory: str | Path) -> Path:
    """Write ``report.html``, which needs no other file, and the charts in ``report/``.

    Returns the path of the page.  An earlier report is replaced when the new one is complete.
    Raises InputError for a folder without results, with damaged ones, or those of another
    version, with a folder of that name which holds anything else, and if it cannot be written to;
    ContactLockingError where the disk is full.
    """
    from contact_locking.results.read import RunResults, read

    from .run_page import run_page
    from .study_page import study_page

    folder = Path(directory)
    with explained(f"no report can be written in {folder}", folder):
        results = read(folder)
        html, charts = run_page(results) if isinstance(results, RunResults) else study_page(results)
        _write_charts(folder, charts)
        write_text(folder / PAGE, html)
    return folder / PAGE


def discard(directory: str | Path) -> None:
    """Remove a report that has become out of date. Raises OSError.

    What is not of this program, though it has the same name, stays.
    """
    folder = Path(directory)
    if not (folder / PAGE).is_file():
        return
    with (folder / PAGE).open(encoding="utf-8", errors="replace") as stream:
        if GENERATOR not in stream.read(_HEAD_CHARACTERS):
            return
    (folder / PAGE).unlink()
    if _holds_charts_only(folder / CHARTS):
        shutil.rmtree(folder / CHARTS)


def _write_charts(folder: Path, charts: Sequence[Chart]) -> None:
    place = folder / CHARTS
    if place.exists() and not _holds_charts_only(place):
        raise InputError(
            f"{place}: is not of a report, as there is more than charts; "
            "move it away, or report another folder"
        )
    remove_abandoned(folder)
    with staging(folder) as unfinished:
        made = unfinished / CHARTS
        made.mkdir()
        for chart in charts:
            chart.write(made)
        put_in_place(made, place)


def _holds_charts_only(folder: Path) -> bool:
    if not folder.is_dir():
        return False
    return all(path.suffix in _CHART_ENDINGS and path.is_file() for path in folder.iterdir())
