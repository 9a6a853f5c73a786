"""From a snapshot to a PNG file, without Matplotlib's global state."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg

from contact_locking.plotting import plane, space, style
from contact_locking.plotting.snapshot import Snapshot


def draw(body: Snapshot, path: Path) -> None:
    """Draw a body in two or three dimensions."""
    with matplotlib.rc_context(style.RC):
        figure = plane.figure(body) if body.dim == 2 else space.figure(body)
        FigureCanvasAgg(figure)
        figure.savefig(
            path,
            dpi=style.DPI,
            format="png",
            facecolor="white",
            bbox_inches="tight",
            pad_inches=0.15,
        )
