"""The result of a run in a window, where there is a screen."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from contact_locking.errors import InputError, NoRendering
from contact_locking.results.names import PICTURE, SNAPSHOT
from contact_locking.results.read import StudyResults, read_all
from contact_locking.view.pictures import offscreen, snapshot_file

_PROGRAM = "contact_locking.view.pictures.window"


def view(directory: str | Path) -> None:
    """Open a window on the results of a run, and return when it is closed.

    Raises InputError for a folder without results, with damaged ones, those of a study or of
    another version, and NoRendering where no window can be opened.
    """
    folder = Path(directory)
    results = read_all(folder)[0]
    if isinstance(results, StudyResults):
        known = (results.case_folder(row) for row in results.rows)
        case = next((path for path in known if path is not None), folder / "cases" / "CASE")
        raise InputError(
            f"{folder}: is the folder of a study; give that of a case, such as {case}\n"
            f"{folder / 'cases' / 'index.txt'} says which is which."
        )
    snapshot = folder / SNAPSHOT
    snapshot_file.load(snapshot)
    look = f"Look at {folder / PICTURE}, or make" if (folder / PICTURE).is_file() else "Make"
    instead = f"{look} a page of the results: contact-locking report {folder}"
    if importlib.util.find_spec("pyvista") is None:
        raise NoRendering(f"a window takes PyVista: {offscreen.INSTALL}\n{instead}")
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        raise NoRendering(f"there is no screen here (DISPLAY is not set)\n{instead}")
    with tempfile.TemporaryFile() as log:
        words = [*offscreen.program(_PROGRAM), str(snapshot)]
        process = subprocess.Popen(words, stderr=log, env=offscreen.environment())
        try:
            code = process.wait()
        finally:
            process.kill()
            process.wait()
        log.seek(0)
        told = log.read().decode(errors="replace")
    if code:
        reason = offscreen.explain(code, told)
        raise NoRendering(f"no window could be opened: {reason}\n{instead}")
