"""The pictures of solutions inside the page."""

from __future__ import annotations

import base64
import io
from pathlib import Path

from PIL import Image

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
