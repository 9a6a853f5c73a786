"""Reports: a page and charts from the files of a finished run or study, without DOLFINx."""

from __future__ import annotations

from pathlib import Path

from contact_locking.errors import explained

from .files import CHARTS, PAGE, discard, replace
from .pdf import print_page

__all__ = ["CHARTS", "PAGE", "discard", "print_page", "write"]


def write(directory: str | Path) -> Path:
    """Write ``report.html``, which needs no other file, and the charts in ``report/``.

    Returns the path of the page.  A new report replaces an earlier one when it is complete.  Raises
    InputError for a folder without results, with damaged results or results of another version,
    for a folder ``report`` with other files, and for a folder that cannot be written to;
    ContactLockingError where the disk is full.
    """
    from contact_locking.results.read import RunResults, read

    from .run_page import run_page
    from .study_page import study_page

    folder = Path(directory)
    with explained(f"no report can be written in {folder}", folder):
        results = read(folder)
        html, charts = run_page(results) if isinstance(results, RunResults) else study_page(results)
        replace(folder, html, charts)
    return folder / PAGE
