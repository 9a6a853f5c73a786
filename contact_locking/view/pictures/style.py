"""Colours that colour-blind readers can tell apart, scales, titles and legends of all pictures."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from contact_locking.arrays import FloatArray
from contact_locking.results.contact_points import STATE_NAMES
from contact_locking.results.in_words import value_in_words
from contact_locking.results.quantities import QUANTITIES
from contact_locking.view.pictures.snapshot import Snapshot

# Okabe and Ito's palette.
BLUE, SKY, ORANGE, VERMILION, BLACK = "#0072B2", "#56B4E9", "#E69F00", "#D55E00", "#1a1a1a"
GREY, PALE = "#7a7a7a", "#e4e4e4"
STATE_COLOURS = (PALE, BLUE, VERMILION)
STATES = ListedColormap(STATE_COLOURS)
#: The labels of units, by the names of the units.
Units = Mapping[str, str]

RC: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titley": 1.0,  # otherwise Matplotlib measures every label to place a title
    "axes.labelsize": 9.5,
    "axes.edgecolor": "#444444",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "hatch.linewidth": 0.6,
    "hatch.color": BLACK,
    "mathtext.fontset": "dejavusans",
}
DPI = 160
#: The height of the title and the numbers of a picture in inches.
HEAD = 0.75

# On the line around the locked zone this share of the cells around a vertex is locked: linear
# elements leave many cells of a zone a little below the limit.
RIM_SHARE = 0.25

# The size of a title in points; the numbers of characters above which a title is smaller, and
# above which it is shortened.
_TITLE_SIZE, _FULL_SIZE_TITLE, _LONGEST_TITLE = 13.0, 56, 120

# The share of the cells whose values are within the scale of colours.
_QUANTILE = 0.99
# Displacements smaller than the first share of the body are magnified to about the second.
_VISIBLE, _SHOWN = 0.03, 0.08


@dataclass(frozen=True)
class Shade:
    """The values (c,) that colour the cells, a masked array, with their scale and label."""

    values: Any
    label: str
    norm: Normalize
    cmap: Colormap
    extend: str


def shade(body: Snapshot) -> Shade:
    """|eps|/M, or |eps| for a body that never locks."""
    limited = np.isfinite(body.locking_limit)
    locks = bool(limited.any())
    if locks:
        values = np.ma.masked_where(~limited, body.strain_norm / body.locking_limit)
        label = r"$|\varepsilon(u)|\,/\,M$"
        label += "" if limited.all() else r"   (grey: $M = \infty$)"
    else:
        values, label = np.ma.asarray(body.strain_norm), r"$|\varepsilon(u)|$"
    present = values.compressed()
    # Few cells exceed the largest colour, as a peak would use up the colours.
    top = float(np.quantile(present, _QUANTILE))
    if locks and 0.5 < top < 1.1:
        top = 1.0
    top = top or float(present.max()) or 1.0
    extend = "max" if present.max() > 1.001 * top else "neither"
    cmap = matplotlib.colormaps["viridis"].with_extremes(bad=PALE)
    return Shade(values, label, Normalize(0.0, top), cmap, extend)


def locked_share(body: Snapshot) -> FloatArray:
    """The share (v,) of the cells around a vertex that are locked."""
    number = np.bincount(body.cells.ravel())
    locked = np.bincount(body.cells[body.locked].ravel(), minlength=len(number))
    return locked / number


def magnification(body: Snapshot) -> float:
    """The factor of the drawn displacement: 1, or a round number if the displacement is small.

    If the gap varies along a contact, the factor is 1, as another would deform the foundation.
    """
    largest = float(np.linalg.norm(body.displacement, axis=1).max(initial=0.0))
    share = largest / body.size
    curved = any(np.ptp(part.points.gap) > 1e-9 * body.size for part in body.contact.parts())
    if curved or not 0.0 < share < _VISIBLE:
        return 1.0
    wanted = _SHOWN / share
    power = 10.0 ** np.floor(np.log10(wanted))
    return power * max(step for step in (1, 2, 5) if step * power <= wanted)


def scale_words(factor: float) -> str:
    """The scale of the displacement, for a title."""
    return "true scale" if factor == 1.0 else f"displacement \u00d7 {factor:g}"


def panel(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """New axes of a size, at distances from the left and the top of the figure, in inches.

    An automatic layout measures all words before they are drawn, which takes as long as to draw.
    """
    across, down = figure.get_size_inches()
    where = (left / across, 1.0 - (top + height) / down, width / across, height / down)
    return figure.add_axes(where)


def labelled(text: str, unit: str, units: Units) -> str:
    """The text with the unit in brackets, as far as there is a label for it."""
    return f"{text} [{units[unit]}]" if unit in units else text


def power_beside(axes: Axes) -> None:
    """The power of ten of the vertical scale stands left of the axis, clear of a title above it."""
    axes.yaxis.get_offset_text().set(x=-0.01, horizontalalignment="right")


def head(figure: Figure, body: Snapshot) -> None:
    """Write the study's title and a line of numbers into the upper `HEAD` inches of the figure."""
    numbers = f"{body.dofs:,} dofs".replace(",", "\u2009")
    if body.locked.any():
        numbers += f"     {value_in_words(QUANTITIES['locked_fraction'], body.locked_fraction)}"
    if not body.converged:
        numbers += "     NOT CONVERGED"
    height = figure.get_figheight()
    # In a title, which users write, a dollar sign begins no formula.
    title = textwrap.shorten(body.title or "Locking body in contact", _LONGEST_TITLE)
    size = _TITLE_SIZE * min(1.0, _FULL_SIZE_TITLE / len(title))
    centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    figure.text(0.5, 1.0 - 0.27 / height, title, fontsize=size, fontweight="bold", **centred)
    colour = GREY if body.converged else VERMILION
    figure.text(0.5, 1.0 - 0.55 / height, numbers, fontsize=9, color=colour, **centred)


def state_patches() -> list[Patch]:
    """The legend of open, stick and slip."""
    return [
        Patch(facecolor=colour, edgecolor=GREY, linewidth=0.5, label=name)
        for colour, name in zip(STATE_COLOURS, STATE_NAMES, strict=True)
    ]


def deformed(body: Snapshot, factor: float) -> FloatArray:
    """Vertices (v, d) moved by ``factor`` times their displacement."""
    return body.x + factor * body.displacement


def view_frame(towards: FloatArray) -> FloatArray:
    """The unit vectors (3, 3) to the right, up and ``towards`` a viewer for whom z is upwards."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross(np.eye(3)[2 if abs(towards[2]) < 0.999 else 1], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])
