"""The files of a report: a page beside the results, and a folder of charts."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.files.atomic import remove_abandoned, staging
from contact_locking.results.names import CHARTS

if TYPE_CHECKING:
    from .charts import Chart

#: The name of the page and of the charts of a study whose folder holds the report of a run too.
BESIDE_RUN = "report-study"

#: The name of this program in the head of a page.
GENERATOR = "contact_locking"


def replace(folder: Path, html: str, charts: Sequence[Chart], name: str = CHARTS) -> Path:
    """Write a report in place of an earlier one, and return the path of its page; OSError."""
    remove_abandoned(folder)
    with staging(folder) as unfinished:
        made = unfinished / name
        made.mkdir()
        for chart in charts:
            chart.write(made)
        page = f"{name}.html"
        (unfinished / page).write_text(html, encoding="utf-8", newline="")
        (folder / name).mkdir(exist_ok=True)
        for path in [*made.iterdir(), unfinished / page]:
            os.replace(path, folder / path.relative_to(unfinished))
    return folder / page
