"""An animation of a process in two dimensions, as a GIF file with the times of its frames.

All frames have one scale of colours, one magnification and one window, so that what moves is the
body and not the axes.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from contact_locking.plotting import plane, style
from contact_locking.plotting.snapshot import Snapshot

#: The largest number of frames: a process of more steps has every second, fourth, ... step.
MOST_FRAMES = 40
#: The largest number of cells of a body, beyond which a frame takes seconds to draw.
MOST_CELLS = 100_000

_DPI, _COLOURS, _MILLISECONDS, _LAST = 90, 64, 150, 1200
# The window has this share of its size around the body.
_MARGIN = 0.06


@dataclass(frozen=True)
class Frame:
    """The body at the end of a step."""

    step: int
    time: float
    body: Snapshot


class Film:
    """The frames of a process, at most `MOST_FRAMES` of them, equally far apart, and its end."""

    def __init__(self) -> None:
        self._kept: list[Frame] = []
        self._last: Frame | None = None
        self._stride = self._count = 0

    def add(self, frame: Frame) -> None:
        """Add the next step; a step of another mesh begins a new film."""
        if self._last is not None:
            first = self._last.body
            if len(first.x) != len(frame.body.x):
                self._kept, self._last, self._stride, self._count = [], None, 0, 0
            else:
                # The mesh is in memory once.
                same = {name: getattr(first, name) for name in ("x", "cells", "boundary")}
                frame = replace(frame, body=replace(frame.body, **same))
        self._stride = self._stride or 1
        self._last = frame
        if self._count % self._stride == 0:
            self._kept.append(frame)
        self._count += 1
        if len(self._kept) >= MOST_FRAMES:
            self._kept = self._kept[::2]
            self._stride *= 2

    @property
    def frames(self) -> list[Frame]:
        """The frames in the order of the steps."""
        if self._last is None or self._last is self._kept[-1]:
            return list(self._kept)
        return [*self._kept, self._last]


def gif(frames: Sequence[Frame]) -> bytes:
    """The film as a GIF file, whose comment has the steps and the times as JSON."""
    factor = min(style.magnification(frame.body) for frame in frames)
    shades = [style.shade(frame.body) for frame in frames]
    top = max(float(shade.norm.vmax or 0.0) for shade in shades)
    beyond = any(shade.extend == "max" for shade in shades)
    shades = [
        replace(shade, norm=Normalize(0.0, top), extend="max" if beyond else "neither")
        for shade in shades
    ]
    places = np.concatenate([style.deformed(frame.body, factor) for frame in frames])
    low, high = places.min(axis=0), places.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    window = np.stack([low - margin, high + margin])
    size = window[1] - window[0]
    width = 6.4
    height = float(np.clip(width * 0.78 * size[1] / size[0], 1.6, 6.4)) + 0.7
    images = []
    with matplotlib.rc_context(style.RC):
        for frame, shade in zip(frames, shades, strict=True):
            figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
            canvas = FigureCanvasAgg(figure)
            axes = figure.add_subplot()
            plane.draw_frame(figure, axes, frame.body, factor, shade, window)
            axes.set_title(f"t = {frame.time:.4g}", loc="left", parse_math=False)
            images.append(_image(canvas))
    comment = json.dumps(
        {"steps": [frame.step for frame in frames], "times": [frame.time for frame in frames]}
    )
    durations = [_MILLISECONDS] * (len(images) - 1) + [_LAST]
    stream = io.BytesIO()
    images[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=durations,
        loop=0,
        comment=comment.encode(),
        # Equal frames stay frames of their own, as each has its time.
        optimize=False,
        disposal=2,
    )
    return stream.getvalue()


def _image(canvas: FigureCanvasAgg) -> Image.Image:
    canvas.draw()
    whole = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    return whole.quantize(_COLOURS, dither=Image.Dither.NONE)
