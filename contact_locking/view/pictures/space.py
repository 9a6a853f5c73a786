"""The picture of a body in three dimensions: a sheet of views that PyVista draws.

PyVista has a process of its own: without a screen VTK raises no error but ends its process, which
must not be the one of the solve.
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
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from contact_locking.errors import NoRendering
from contact_locking.view.pictures import style
from contact_locking.view.pictures.style import Snapshot, save

Image = npt.NDArray[np.uint8]

INSTALL = "apt-get install python3-pyvista xvfb xauth libgl1-mesa-dri, or pip install pyvista"

# In inches.
_WIDTH, _TITLE, _PAD = 4.0, 0.35, 0.05


def figure(body: Snapshot) -> Figure:
    """The views of a body with their titles, in two columns.  Raises NoRendering."""
    images = views(body)
    down, across, _ = next(iter(images.values())).shape
    height = _WIDTH * down / across
    sheet = Figure(figsize=(2.0 * _WIDTH, style.HEAD + -(-len(images) // 2) * (_TITLE + height)))
    style.head(sheet, body)
    for number, (title, image) in enumerate(images.items()):
        row, column = divmod(number, 2)
        left, top = column * _WIDTH + _PAD, style.HEAD + row * (_TITLE + height) + _TITLE
        axes = style.panel(sheet, left, top, _WIDTH - 2 * _PAD, height - _PAD)
        axes.set_axis_off()
        axes.imshow(image)
        # A title ends with names of the user, in which a dollar sign begins no formula.
        axes.set_title(title, loc="left", parse_math=False)
    sheet.axes[0].set_title(style.scale_words(style.magnification(body)), loc="right")
    return sheet


# Python imports nothing from the current folder.
_PROGRAM = (sys.executable, "-P", "-m", "contact_locking.view.pictures.render")
_SECONDS, _GRACE_SECONDS = 120, 2
#: A command that gives a program a hidden screen, which stays when a client has gone.
XVFB = ("xvfb-run", "-a", "-s", "-screen 0 640x480x24 -noreset")


def views(body: Snapshot) -> dict[str, Image]:
    """Pictures (h, w, 3) of all views of a body, by their titles.  Raises NoRendering."""
    if importlib.util.find_spec("pyvista") is None:
        raise NoRendering("PyVista is not installed")
    hidden = shutil.which(XVFB[0]) is not None
    try:
        with tempfile.TemporaryDirectory(prefix="contact-locking-") as folder:
            source, target = Path(folder) / "snapshot.npz", Path(folder) / "views.npz"
            save(body, source)
            # The program has a time limit of its own, in case this process ends first.
            words = [*_PROGRAM, str(source), str(target), str(2 * _SECONDS)]
            _run([*XVFB, *words] if hidden else words, folder)
            with np.load(target) as images:
                return dict(images)
    except OSError as error:
        raise NoRendering(f"{type(error).__name__}: {error}") from error


def environment() -> dict[str, str]:
    """The environment in which the program finds this package as this process has found it."""
    root = str(Path(__file__).resolve().parents[3])
    known = os.environ.get("PYTHONPATH")
    return os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{known}" if known else root}


def _run(words: list[str], folder: str) -> None:
    """Run a program that has all its files in ``folder``.

    Raises NoRendering if the program fails or does not end in time.
    """
    with (Path(folder) / "log").open("w+", errors="replace") as log:
        process = subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=log,
            env=environment() | {"TMPDIR": folder},
            start_new_session=True,
        )
        try:
            code = process.wait(_SECONDS)
        except subprocess.TimeoutExpired:
            raise NoRendering(f"VTK has not finished in {_SECONDS} seconds") from None
        finally:
            # The first signal is a request, after which a hidden screen removes its lock.
            for number in (signal.SIGTERM, signal.SIGKILL) if process.poll() is None else ():
                with contextlib.suppress(subprocess.TimeoutExpired, ProcessLookupError):
                    os.killpg(process.pid, number)
                    process.wait(_GRACE_SECONDS)
        log.seek(0)
        if code:
            # The program ends with a line about its error, in which VTK uses colours.
            said = re.sub(r"\x1b\[[0-9;]*m", "", log.read()).strip().rpartition("\n")[-1]
            raise NoRendering(f"VTK ended with exit code {code}: {said or 'is there a screen?'}")
