"""The files of a report: a page beside the results, a folder of charts, and a PDF file."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from contact_locking.errors import ContactLockingError, explained
from contact_locking.files import atomic
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


_PROGRAMS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    *("--headless", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"),
    *("--disable-background-networking", "--no-pdf-header-footer"),
)
_SECONDS = 120


def print_page(page: Path) -> Path:
    """Print a page of `write` into the folder of its charts; returns the path of the PDF file.

    The file goes with the charts when the report is replaced or discarded.  Raises
    ContactLockingError if no Chromium is installed or if Chromium fails.
    """
    program = next((path for name in _PROGRAMS if (path := shutil.which(name))), None)
    if program is None:
        raise ContactLockingError(
            f"a PDF file takes Chromium, and none of {', '.join(_PROGRAMS)} is installed: "
            f"apt-get install chromium, or print {page} from a browser"
        )
    folder = page.with_suffix("")
    name = f"{folder.name}/{folder.name}.pdf"
    with (
        explained(f"no PDF file can be written in {folder}", folder),
        atomic.staging(folder) as unfinished,
    ):
        made, profile = unfinished / name, unfinished / "profile"
        made.parent.mkdir()
        # Chromium refuses to run as root with its sandbox, and the page runs no script of others.
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
        command = [program, *_OPTIONS, *sandbox, f"--user-data-dir={profile}"]
        command += [f"--print-to-pdf={made}", page.resolve().as_uri()]
        try:
            subprocess.run(command, capture_output=True, timeout=_SECONDS, check=True)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            raise ContactLockingError(f"{program} could not print {page}: {_why(error)}") from error
        if not made.exists():
            raise ContactLockingError(f"{program} has printed nothing of {page}")
        os.replace(made, page.parent / name)
    return page.parent / name


def _why(error: subprocess.CalledProcessError | subprocess.TimeoutExpired) -> str:
    if isinstance(error, subprocess.TimeoutExpired):
        return f"it was not done after {_SECONDS} s"
    told = (error.stderr or b"").decode(errors="replace").strip().splitlines()
    return told[-1] if told else f"it ended with code {error.returncode}"
