"""Reports: a page and charts from the files of a finished run or study, without DOLFINx."""

from __future__ import annotations

from pathlib import Path

from contact_locking.errors import InputError, explained
from contact_locking.plain_text import defect
from contact_locking.results.names import CHARTS, PAGE

from .files import BESIDE_RUN, replace

__all__ = ["CHARTS", "PAGE", "write"]


def write(directory: str | Path) -> list[Path]:
    """Write ``report.html``, which needs no other file, and the charts in ``report/``.

    A folder with a run and a study gets ``report.html`` for the run, and ``report-study.html`` with
    ``report-study/`` for the study.  Returns the paths of the pages.  A new report replaces an
    earlier one when it is complete.  Raises InputError for a folder without results, with damaged
    results or results of another version, and for a folder that cannot be written to;
    ContactLockingError where the disk is full.
    """
    from jinja2 import TemplateError

    from contact_locking.results.read import RunResults, read_all

    from .run_page import run_page
    from .study_page import study_page

    # The errors of a page whose numbers are no numbers, or are not there.
    damage = (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, TemplateError)
    folder, pages = Path(directory), list[Path]()
    with explained(f"no report can be written in {folder}", folder):
        for results in read_all(folder):
            name = BESIDE_RUN if pages else CHARTS
            try:
                made = run_page(results) if isinstance(results, RunResults) else study_page(results)
            except damage as error:
                what = f"{folder}: its results are damaged: {defect(error)}; solve again"
                raise InputError(what) from error
            pages.append(replace(folder, *made, name))
    return pages
