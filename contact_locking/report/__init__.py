"""Reports: a page and charts from the files of a finished run or study, without DOLFINx."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.errors import InputError

if TYPE_CHECKING:
    from .charts import Chart

PAGE, CHARTS = "report.html", "report"


def write(directory: str | Path) -> Path:
    """Write ``report.html``, which needs no other file, and the charts in ``report/``.

    Returns the path of the page.  An earlier report is replaced when the new one is complete.
    Raises InputError for a folder without results, with damaged ones, or those of another
    version, and if it cannot be written to.
    """
    from contact_locking.studies.files import write_text

    from .folder import RunResults, read
    from .run_page import run_page
    from .study_page import study_page

    folder = Path(directory)
    with _explained(folder):
        results = read(folder)
        make_page = run_page(results) if isinstance(results, RunResults) else study_page(results)
        html, charts = make_page
        _write_charts(folder, charts)
        write_text(folder / PAGE, html)
    return folder / PAGE


def _write_charts(folder: Path, charts: Sequence[Chart]) -> None:
    staging = Path(tempfile.mkdtemp(prefix=".partial-report-", dir=folder))
    try:
        made, place = staging / "new", folder / CHARTS
        made.mkdir()
        for chart in charts:
            chart.write(made)
        with contextlib.suppress(FileNotFoundError):
            place.rename(staging / "old")
        made.rename(place)
    finally:
        shutil.rmtree(staging, ignore_errors=True)


@contextlib.contextmanager
def _explained(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        where = error.filename or folder
        raise InputError(
            f"no report can be written in {folder}: {error.strerror or error} ({where})"
        ) from error
