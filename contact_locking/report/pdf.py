"""The page of a report as a PDF file, printed by Chromium, where that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from contact_locking.errors import ContactLockingError, explained
from contact_locking.files import atomic, ownership

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
        ownership.replace(page.parent, unfinished, [name])
    return page.parent / name


def _why(error: subprocess.CalledProcessError | subprocess.TimeoutExpired) -> str:
    """In one line why Chromium failed."""
    if isinstance(error, subprocess.TimeoutExpired):
        return f"it was not done after {_SECONDS} s"
    told = (error.stderr or b"").decode(errors="replace").strip().splitlines()
    return told[-1] if told else f"it ended with code {error.returncode}"
