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

from contact_locking.extras.pictures.animation import MOST_FRAMES

_WIDTH, _THUMBNAIL_WIDTH = 1400, 480
# Far above any picture of this program; a small file may unpack to more than the memory.
_MOST_PIXELS = 50_000_000


def picture(path: Path) -> str | None:
    """A picture as a data URI; None if the file is no PNG."""
    return _embedded(path, _WIDTH)


def thumbnail(path: Path) -> str | None:
    """A small picture of 256 colours as a data URI; None if the file is no PNG."""
    return _embedded(path, _THUMBNAIL_WIDTH, colours=256)


def _embedded(path: Path, width: int, colours: int | None = None) -> str | None:
    stream = io.BytesIO()
    try:
        with Image.open(path, formats=["PNG"]) as opened:
            if opened.width * opened.height > _MOST_PIXELS:
                return None
            image: Image.Image = opened.convert("RGB")
        if image.width > width:
            size = (width, max(1, round(image.height * width / image.width)))
            image = image.resize(size, Image.Resampling.LANCZOS)
        if colours is not None:
            image = image.quantize(colours)
        image.save(stream, format="PNG", optimize=True)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"


# A small file may unpack to more than the memory.
_MOST_PIXELS_OF_FRAMES, _MOST_BYTES, _LONGEST_COMMENT = 4_000_000, 20_000_000, 20_000


@dataclass(frozen=True)
class PageFrame:
    """A frame as a data URI, with its step and its time."""

    step: int
    time: float
    image: str

    @property
    def caption(self) -> str:
        """The time and the step in words."""
        return f"t = {self.time:.4g}, step {self.step}"


def frames(path: Path | None) -> list[PageFrame]:
    """The frames of an animation of this program; none without a file, or if it is damaged."""
    if path is None:
        return []
    try:
        return _read(path)
    except (OSError, ValueError, SyntaxError, KeyError, TypeError, EOFError, RecursionError):
        return []
    except Image.DecompressionBombError:
        return []


def _read(path: Path) -> list[PageFrame]:
    if path.stat().st_size > _MOST_BYTES:
        return []
    found = []
    with Image.open(path, formats=["GIF"]) as opened:
        comment = opened.info["comment"]
        if opened.width * opened.height > _MOST_PIXELS_OF_FRAMES or len(comment) > _LONGEST_COMMENT:
            return []
        facts: Any = json.loads(comment)
        steps, times = facts["steps"], facts["times"]
        count: int = getattr(opened, "n_frames", 1)
        if not 1 < count == len(steps) == len(times) <= MOST_FRAMES + 1:
            return []
        for number, (step, time) in enumerate(zip(steps, times, strict=True)):
            if not math.isfinite(float(time)):
                return []
            opened.seek(number)
            stream = io.BytesIO()
            opened.convert("RGB").quantize(256).save(stream, format="PNG", optimize=True)
            data = base64.b64encode(stream.getvalue()).decode("ascii")
            found.append(PageFrame(int(step), float(time), f"data:image/png;base64,{data}"))
    return found
