"""The pictures of solutions, and the frames of an animation, inside the page."""

from __future__ import annotations

import base64
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from contact_locking.view.pictures.animation import MOST_FRAMES

_WIDTH, _THUMBNAIL_WIDTH = 1400, 480
# The errors of Pillow and json for a damaged file, or one that unpacks to more than the memory.
_DAMAGE = (
    *(OSError, ValueError, SyntaxError, KeyError, TypeError, EOFError, RecursionError),
    Image.DecompressionBombError,
)


def picture(path: Path) -> str | None:
    """A picture as a data URI; None if the file is no PNG."""
    return _embedded(path, _WIDTH)


def thumbnail(path: Path) -> str | None:
    """A small picture of 256 colours as a data URI; None if the file is no PNG."""
    return _embedded(path, _THUMBNAIL_WIDTH, colours=256)


def _embedded(path: Path, width: int, colours: int | None = None) -> str | None:
    try:
        with Image.open(path, formats=["PNG"]) as opened:
            image: Image.Image = opened.convert("RGB")
        if image.width > width:
            size = (width, max(1, round(image.height * width / image.width)))
            image = image.resize(size, Image.Resampling.LANCZOS)
        return _as_text(image if colours is None else image.quantize(colours))
    except _DAMAGE:
        return None


def _as_text(image: Image.Image) -> str:
    stream = io.BytesIO()
    image.save(stream, format="PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"


@dataclass(frozen=True)
class PageFrame:
    """A frame as a data URI, with its time and its step in words."""

    caption: str
    image: str


def frames(path: Path | None) -> list[PageFrame]:
    """The frames of an animation of this program; none without a file, or if it is damaged."""
    try:
        return [] if path is None else _read(path)
    except _DAMAGE:
        return []


def _read(path: Path) -> list[PageFrame]:
    found = []
    with Image.open(path, formats=["GIF"]) as opened:
        facts: Any = json.loads(opened.info["comment"])
        steps, times = facts["steps"], [float(time) for time in facts["times"]]
        count: int = getattr(opened, "n_frames", 1)
        if not 1 < count == len(steps) == len(times) <= MOST_FRAMES + 1:
            return []
        if not all(map(math.isfinite, times)):
            return []
        for number, (step, time) in enumerate(zip(steps, times, strict=True)):
            opened.seek(number)
            image = _as_text(opened.convert("RGB").quantize(256))
            found.append(PageFrame(f"t = {time:.4g}, step {int(step)}", image))
    return found
