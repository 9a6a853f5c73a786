"""An animation of a process, as a GIF file with the times of its frames.

All frames have one scale of colours, one magnification and one window or camera, so that what moves
is the body and not the axes.
"""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from PIL import Image

from contact_locking.view.pictures import (
    offscreen,
    plane,
    snapshot_file,
    space,
    style,
)
from contact_locking.view.pictures.snapshot import Snapshot, seen_from_outside
from contact_locking.view.pictures.style import look_of

#: The largest number of frames: a process of more steps has every second, fourth, ... step.
MOST_FRAMES = 40
#: The largest number of pieces of a body's cells by the dimension, beyond which it takes seconds to
#: gather or to draw a frame.
MOST_PIECES = {2: 100_000, 3: 1_000_000}

_DPI, _MILLISECONDS, _LAST = 90, 150, 1200
# The palette has so many colours of the scale, and others, which are those of so many pictures.
_LEVELS, _OTHERS, _SAMPLES = 80, 175, 8
_OF_THE_MESH = ("x", "cells", "boundary", "boundary_cell")


@dataclass(frozen=True)
class Frame:
    """The body at the end of a step."""

    step: int
    time: float
    body: Snapshot


class Film:
    """At most `MOST_FRAMES` frames of a process on one mesh, equally far apart, and the last."""

    def __init__(self) -> None:
        #: The frames in the order of the steps.
        self.frames: list[Frame] = []
        self._stride, self._count = 1, 0

    def add(self, frame: Frame) -> None:
        """Add the next step."""
        body = seen_from_outside(frame.body)
        if self.frames:
            # The mesh is in memory once.
            same = {name: getattr(self.frames[0].body, name) for name in _OF_THE_MESH}
            body = replace(body, **same)
        if (self._count - 1) % self._stride:
            self.frames.pop()
        self.frames.append(replace(frame, body=body))
        if self._count % self._stride == 0 and len(self.frames) >= MOST_FRAMES:
            self.frames = [*self.frames[::2], self.frames[-1]]
            self._stride *= 2
        self._count += 1


def animation(frames: Sequence[Frame]) -> bytes:
    """The film as a GIF file, whose comment has the steps and the times as JSON.

    Raises NoRendering in three dimensions if PyVista cannot draw.
    """
    bodies, titles = [frame.body for frame in frames], [f"t = {frame.time:.4g}" for frame in frames]
    look = look_of(bodies)
    with matplotlib.rc_context(style.RC):
        if bodies[0].dim == 2:
            figures = plane.frames(bodies, look, titles)
        else:
            figures = space.frames(_images(bodies), titles)
        pictures = [_picture(figure) for figure in figures]
    pictures = _in_few_colours(pictures, look.shades[0].cmap)
    comment = json.dumps(
        {"steps": [frame.step for frame in frames], "times": [frame.time for frame in frames]}
    )
    durations = [_MILLISECONDS] * (len(pictures) - 1) + [_LAST]
    stream = io.BytesIO()
    pictures[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=pictures[1:],
        duration=durations,
        loop=0,
        comment=comment.encode(),
        # Equal frames stay frames of their own, as each has its time.
        optimize=False,
        disposal=2,
    )
    return stream.getvalue()


def _images(bodies: Sequence[Snapshot]) -> list[offscreen.Image]:
    """The pictures of bodies in three dimensions."""
    with tempfile.TemporaryDirectory(prefix="contact-locking-") as folder:
        for number, body in enumerate(bodies):
            snapshot_file.save(body, Path(folder) / f"{number:04d}.npz", compressed=False)
        images = offscreen.views(Path(folder))
    return [images[name] for name in sorted(images)]


def _picture(figure: Figure) -> Image.Image:
    figure.set_dpi(_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _in_few_colours(pictures: Sequence[Image.Image], scale: Colormap) -> list[Image.Image]:
    """The pictures with one palette for all, which has the colours of the scale."""
    some = [*pictures[:: -(-len(pictures) // _SAMPLES)], pictures[-1]]
    sheet = Image.fromarray(np.vstack([np.asarray(picture) for picture in some]))
    others = sheet.quantize(_OTHERS, Image.Quantize.MAXCOVERAGE).getpalette() or []
    levels = scale(np.linspace(0.0, 1.0, _LEVELS), bytes=True)[:, :3]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*levels.ravel().tolist(), *others])
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
