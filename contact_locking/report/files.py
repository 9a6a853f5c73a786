"""The files of a report: a page beside the results, and a folder of charts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.files import ownership
from contact_locking.files.atomic import remove_abandoned, staging

if TYPE_CHECKING:
    from .charts import Chart

PAGE, CHARTS = "report.html", "report"
#: The name of the page and of the charts of a study whose folder holds the report of a run too.
BESIDE_RUN = "report-study"

#: The name of this program in the head of a page.
GENERATOR = "contact_locking"


def replace(folder: Path, html: str, charts: Sequence[Chart], name: str = CHARTS) -> Path:
    """Write a report in place of an earlier one, and return the path of the page.

    Raises OSError, and InputError if files of others are in its place.
    """
    remove_abandoned(folder)
    with staging(folder) as unfinished:
        made = unfinished / name
        made.mkdir()
        for chart in charts:
            chart.write(made)
        page = f"{name}.html"
        (unfinished / page).write_text(html, encoding="utf-8", newline="")
        ownership.replace(folder, unfinished, [name, page])
    return folder / page


def discard(directory: str | Path) -> None:
    """Remove a report that has become out of date.  Raises OSError.

    What others have put in its place stays.
    """
    folder = Path(directory)
    own = [name for name in (PAGE, CHARTS) if ownership.is_own(folder / name)]
    with staging(folder) as empty:
        ownership.replace(folder, empty, own)
