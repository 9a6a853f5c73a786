"""Reports: a page and charts from the files of a finished run or study, without DOLFINx."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.errors import InputError, explained
from contact_locking.files import remove_abandoned, staging
from contact_locking.results.output import CHARTS, PAGE

if TYPE_CHECKING:
    from .page import Chart

__all__ = ["CHARTS", "PAGE", "write"]

# The name of the page and of the charts of a study whose folder holds the report of a run too.
_BESIDE_RUN = "report-study"


def write(directory: str | Path) -> list[Path]:
    """Write ``report.html``, which needs no other file, and the charts in ``report/``.

    A folder with a run and a study gets ``report.html`` for the run, and ``report-study.html`` with
    ``report-study/`` for the study.  Returns the paths of the pages.  A new report replaces an
    earlier one when it is complete.  Raises InputError for a folder without results, with damaged
    results or results of another version, and for a folder that cannot be written to;
    ContactLockingError where the disk is full.
    """
    from jinja2 import TemplateError
    from PIL import UnidentifiedImageError

    from .folders import RunResults, read_all
    from .pages import run_page, study_page

    # The errors of files that were cut off, and of numbers that are no numbers, or are not there.
    missing = (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
    folder = Path(directory)
    with explained(f"no report can be written in {folder}", folder):
        try:
            pages = [
                run_page(results) if isinstance(results, RunResults) else study_page(results)
                for results in read_all(folder)
            ]
        except (*missing, TemplateError, UnidentifiedImageError) as error:
            what = f"{folder}: its results are damaged: {error!r}; solve again"
            raise InputError(what) from error
        names = (CHARTS, _BESIDE_RUN)
        return [_replace(folder, *made, name) for made, name in zip(pages, names, strict=False)]


def _replace(folder: Path, html: str, charts: Sequence[Chart], name: str) -> Path:
    """Write a report in place of an earlier one, and return the path of its page; OSError."""
    remove_abandoned(folder)
    with staging(folder) as unfinished:
        made, page = unfinished / name, f"{name}.html"
        made.mkdir()
        for chart in charts:
            (made / f"{chart.name}.svg").write_text(chart.svg, encoding="utf-8")
            (made / f"{chart.name}.png").write_bytes(chart.png)
        (unfinished / page).write_text(html, encoding="utf-8", newline="")
        (folder / name).mkdir(exist_ok=True)
        for path in [*made.iterdir(), unfinished / page]:
            os.replace(path, folder / path.relative_to(unfinished))
    return folder / page
