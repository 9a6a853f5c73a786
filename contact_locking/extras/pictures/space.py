"""The picture of a body in three dimensions: a sheet with views that PyVista has drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from matplotlib.figure import Figure

from contact_locking.extras.pictures import style
from contact_locking.extras.pictures.offscreen import Image
from contact_locking.extras.pictures.snapshot import Snapshot

_WIDTH, _TITLE, _HEAD = 4.0, 0.35, 0.75


def figure(body: Snapshot, images: Mapping[str, Image]) -> Figure:
    """The views of a body with their titles, in two columns."""
    rows = -(-len(images) // 2)
    height = _HEAD + rows * (_height(*images.values()) + _TITLE)
    sheet = Figure(figsize=(2.0 * _WIDTH, height), layout="constrained")
    style.head(sheet, body)
    places = sheet.subplots(rows, 2, squeeze=False).ravel()
    for axes in places:
        axes.set_axis_off()
    for axes, (title, image) in zip(places, images.items(), strict=False):
        axes.imshow(image)
        # A title ends with names of the user, in which a dollar sign begins no formula.
        axes.set_title(title, loc="left", parse_math=False)
    places[0].set_title(style.scale_words(style.magnification(body)), loc="right")
    return sheet


def frames(images: Sequence[Image], titles: Sequence[str]) -> Iterator[Figure]:
    """The pictures of an animation, each with its title."""
    for image, title in zip(images, titles, strict=True):
        sheet = Figure(figsize=(_WIDTH, _height(image) + _TITLE), layout="constrained")
        axes = sheet.add_subplot()
        axes.set_axis_off()
        axes.imshow(image)
        axes.set_title(title, loc="left", parse_math=False)
        yield sheet


def _height(image: Image, *others: Image) -> float:
    return _WIDTH * image.shape[0] / image.shape[1]
