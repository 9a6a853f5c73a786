"""The pictures of solutions inside the page."""

from __future__ import annotations

import base64
import io
from pathlib import Path

from PIL import Image

_WIDTH, _THUMBNAIL_WIDTH = 1400, 480
# The errors of Pillow for a damaged file, or one that unpacks to more than the memory.
_DAMAGE = (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError)


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
        if colours is not None:
            image = image.quantize(colours)
    except _DAMAGE:
        return None
    stream = io.BytesIO()
    image.save(stream, format="PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
