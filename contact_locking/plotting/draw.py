"""From a snapshot to a PNG file, without Matplotlib's global state."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg

from contact_locking.plotting import plane, space, space_plain, style
from contact_locking.plotting.snapshot import Snapshot
from contact_locking.plotting.views import Image


def draw(body: Snapshot, path: Path, images: Mapping[str, Image] | None = None) -> None:
    """Draw a body; in three dimensions ``images`` are its views, None if PyVista cannot draw."""
    with matplotlib.rc_context(style.RC):
        if body.dim == 2:
            figure = plane.figure(body)
        elif images is not None:
            figure = space.figure(body, images)
        else:
            figure = space_plain.figure(body)
        FigureCanvasAgg(figure)
        figure.savefig(
            path,
            dpi=style.DPI,
            format="png",
            facecolor="white",
            bbox_inches="tight",
            pad_inches=0.15,
            # Files a sixth larger than by the default of 6, in a third of the time.
            pil_kwargs={"compress_level": 3},
        )
