"""The files of a report: a page beside the results, and a folder of charts."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.errors import InputError
from contact_locking.files.atomic import put_in_place, remove_abandoned, staging, write_text

if TYPE_CHECKING:
    from .charts import Chart

PAGE, CHARTS = "report.html", "report"

#: The name of this program in the head of a page.
GENERATOR = "contact_locking"

_CHART_ENDINGS = (".svg", ".png", ".pdf")
_HEAD_CHARACTERS = 1000


def replace(folder: Path, html: str, charts: Sequence[Chart]) -> None:
    """Write a report in place of an earlier one.

    Raises OSError, and InputError if the folder of the charts holds other files.
    """
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
    write_text(folder / PAGE, html)


def discard(directory: str | Path) -> None:
    """Remove a report that has become out of date.  Raises OSError.

    A page of another program stays, and so does a folder with files other than charts.
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


def _holds_charts_only(folder: Path) -> bool:
    if not folder.is_dir():
        return False
    return all(path.suffix in _CHART_ENDINGS and path.is_file() for path in folder.iterdir())
