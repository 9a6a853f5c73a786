"""Views of a body, drawn by PyVista in a process of their own.

Without a screen VTK raises no error but ends its process, which must not be the one of the solve.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from contact_locking.errors import NoRendering
from contact_locking.view.pictures.snapshot import Snapshot, save

Image = npt.NDArray[np.uint8]

INSTALL = "apt-get install python3-pyvista xvfb xauth libgl1-mesa-dri, or pip install pyvista"

# Python imports nothing from the current folder.
_PROGRAM = (sys.executable, "-P", "-m", "contact_locking.view.pictures.render")
_SOURCE, _TARGET = "snapshot.npz", "views.npz"
_SECONDS, _GRACE_SECONDS = 120, 2
_ESCAPES = re.compile(r"\x1b\[[0-9;]*m")
_SHELL, _CRASHED = 128, "VTK was ended by"
#: A command that gives a program a hidden screen, which stays when a client has gone.
XVFB = ("xvfb-run", "-a", "-s", "-screen 0 640x480x24 -noreset")


def views(body: Snapshot) -> dict[str, Image]:
    """Pictures (h, w, 3) of all views of a body, by their titles.  Raises NoRendering."""
    if importlib.util.find_spec("pyvista") is None:
        raise NoRendering("PyVista is not installed")
    hidden = shutil.which(XVFB[0]) is not None
    try:
        with tempfile.TemporaryDirectory(prefix="contact-locking-") as folder:
            save(body, Path(folder) / _SOURCE)
            reason = _draw(XVFB if hidden else (), Path(folder))
            if reason is None:
                with np.load(Path(folder) / _TARGET, allow_pickle=False) as images:
                    return {name: images[name] for name in images.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        reason = f"{type(error).__name__}: {error}"
    # VTK from PyPI draws without a screen.
    no_screen = sys.platform == "linux" and not hidden and not os.environ.get("DISPLAY")
    if no_screen and reason.startswith(_CRASHED):
        reason = "there is no screen, and no xvfb-run, which makes one for VTK"
    raise NoRendering(reason)


def environment() -> dict[str, str]:
    """The environment in which the program finds this package as this process has found it."""
    here = str(Path(__file__).resolve().parents[3])
    known = os.environ.get("PYTHONPATH")
    return os.environ | {"PYTHONPATH": f"{here}{os.pathsep}{known}" if known else here}


def _explain(code: int, told: str) -> str:
    """The reason why a program has ended, from its exit code and the text that it has written."""
    lines = _ESCAPES.sub("", told).strip().splitlines()
    said = f": {lines[-1].strip()}" if lines else ""
    # The shell of xvfb-run adds 128 to the number of the signal.
    number = -code if code < 0 else code - _SHELL
    with contextlib.suppress(ValueError):
        return f"{_CRASHED} {signal.Signals(number).name}{said}"
    return f"VTK ended with exit code {code}{said}"


def _draw(screen: Sequence[str], folder: Path) -> str | None:
    """Run the program that draws and return None, or the reason why the program failed.

    All files are in ``folder``.  Raises NoRendering if the program does not end in time.
    """
    target, log = folder / _TARGET, folder / "log"
    # The program has a time limit of its own, in case this process ends first.
    source, seconds = folder / _SOURCE, str(2 * _SECONDS)
    words = [*screen, *_PROGRAM, str(source), str(target), seconds]
    with log.open("wb") as stream:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stream,
            env=environment() | {"TMPDIR": str(folder)},
            start_new_session=True,
        )
        try:
            code = process.wait(_SECONDS)
        except subprocess.TimeoutExpired:
            raise NoRendering(f"VTK has not finished in {_SECONDS} seconds") from None
        finally:
            if process.poll() is None:
                _end(process)
    return _explain(code, log.read_text(errors="replace")) if code else None


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a program and all programs that it has started.

    The first signal is a request, after which a hidden screen removes its lock.
    """
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE_SECONDS)
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
