"""The picture of a body in three dimensions: a sheet with views that PyVista has drawn."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from contact_locking.view.pictures import style
from contact_locking.view.pictures.offscreen import Image
from contact_locking.view.pictures.snapshot import Snapshot

_WIDTH, _TITLE, _PAD = 4.0, 0.35, 0.05


def figure(body: Snapshot, images: Mapping[str, Image]) -> Figure:
    """The views of a body with their titles, in two columns."""
    rows = -(-len(images) // 2)
    each = _TITLE + _height(*images.values())
    sheet = Figure(figsize=(2.0 * _WIDTH, style.HEAD + rows * each))
    style.head(sheet, body)
    for number, (title, image) in enumerate(images.items()):
        row, column = divmod(number, 2)
        _view(sheet, column * _WIDTH, style.HEAD + row * each, image, title)
    sheet.axes[0].set_title(style.scale_words(style.magnification(body)), loc="right")
    return sheet


def _view(sheet: Figure, left: float, top: float, image: Image, title: str) -> None:
    """A view with its title; left and top are distances in inches."""
    axes = style.panel(sheet, left + _PAD, top + _TITLE, _WIDTH - 2 * _PAD, _height(image) - _PAD)
    axes.set_axis_off()
    axes.imshow(image)
    # A title ends with names of the user, in which a dollar sign begins no formula.
    axes.set_title(title, loc="left", parse_math=False)


def _height(image: Image, *others: Image) -> float:
    return _WIDTH * image.shape[0] / image.shape[1]
