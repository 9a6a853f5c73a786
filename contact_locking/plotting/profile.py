"""Pressure and friction along curves of Gamma_C, with a strip that shows the state below."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.plotting import style

_MOST_MARKERS = 60
# A contact whose tractions are a smaller share than this of the largest one is open.
_UNTOUCHED = 1e-6


@dataclass(frozen=True)
class Curve:
    """Values (k,) along a connected part of Gamma_C; ``s`` are the places of the points.

    ``friction`` is the component of sigma_tau along the curve, ``smoothed`` is |R sigma_nu|.
    """

    s: FloatArray
    pressure: FloatArray
    friction: FloatArray
    bound: FloatArray
    state: IntArray
    smoothed: FloatArray | None = None


def draw(
    axes: Axes, strip: Axes, curves: Sequence[Curve], label: str, largest: float = 0.0
) -> None:
    """Draw the tractions into ``axes``, the states into the narrow ``strip`` below.

    ``largest`` is the largest traction on all of Gamma_C.  What is left of the method's tractions
    where a contact is open is flat beside it.
    """
    for number, curve in enumerate(curves):
        name = (lambda text: text) if number == 0 else (lambda text: "_" + text)
        axes.fill_between(
            curve.s,
            -curve.bound,
            curve.bound,
            color=style.ORANGE,
            alpha=0.22,
            lw=0.0,
            label=name(r"friction bound $\pm\mu\,|R\sigma_\nu|$"),
        )
        axes.plot(
            curve.s,
            curve.pressure,
            color=style.BLUE,
            lw=1.8,
            label=name(r"contact pressure $-\sigma_\nu$"),
        )
        if curve.smoothed is not None:
            axes.plot(
                curve.s,
                curve.smoothed,
                color=style.BLACK,
                lw=1.2,
                ls=(0, (5, 2)),
                label=name(r"smoothed $|R\sigma_\nu|$"),
            )
        axes.plot(
            curve.s,
            curve.friction,
            color=style.VERMILION,
            lw=1.6,
            marker="o" if len(curve.s) <= _MOST_MARKERS else "",
            ms=2.2,
            label=name(r"friction traction $\sigma_\tau$"),
        )
        _state_strip(strip, curve.s, curve.state)
    tractions = [(curve.pressure, curve.friction, curve.bound) for curve in curves]
    peak = max(np.abs(values).max(initial=0.0) for each in tractions for values in each)
    if peak < _UNTOUCHED * largest:
        axes.set_ylim(-0.5 * largest, largest)
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.set_ylabel("traction")
    axes.tick_params(labelbottom=False)
    axes.margins(x=0.0)
    strip.sharex(axes)
    strip.set_yticks([])
    strip.set_xlabel(label, loc="left")
    strip.set_ylabel("state", rotation=0, ha="right", va="center")
    for side in ("left", "bottom"):
        strip.spines[side].set_visible(False)
    strip.legend(
        handles=style.state_patches(),
        loc="upper right",
        bbox_to_anchor=(1.0, 0.0),
        borderaxespad=2.2,
        ncols=3,
    )


def abscissa(lines: Sequence[FloatArray]) -> tuple[list[FloatArray], str]:
    """The places of the points (k, 2) of each line along an axis, and the label of that axis.

    The places are x, where x is monotone and lines do not overlap, otherwise y, otherwise arc
    length.
    """
    for axis, name in enumerate("xy"):
        along = [line[:, axis] for line in lines]
        steps = [np.diff(s) for s in along]
        if all((step > 0).all() or (step < 0).all() for step in steps) and not _overlap(along):
            return along, f"${name}$"
    position: list[FloatArray] = []
    start = 0.0
    for line in lines:
        lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
        position.append(start + np.concatenate([[0.0], np.cumsum(lengths)]))
        # The next line begins after a small distance.
        start = float(position[-1][-1] + 0.1 * lengths.sum())
    return position, r"arc length along $\Gamma_C$"


def along(vectors: FloatArray, x: FloatArray, s: FloatArray) -> FloatArray:
    """The components (k,) of vectors along a curve, towards where the abscissa ``s`` grows."""
    if len(x) < 2:
        return np.array(vectors[:, 0])
    tangent = np.gradient(x, axis=0)
    length = np.linalg.norm(tangent, axis=1)
    direction = 1.0 if s[-1] >= s[0] else -1.0
    return direction * np.sum(vectors * tangent, axis=1) / np.where(length > 0.0, length, 1.0)


def _overlap(along: list[FloatArray]) -> bool:
    intervals = sorted((float(s.min()), float(s.max())) for s in along)
    return any(b[0] < a[1] for a, b in itertools.pairwise(intervals))


def _state_strip(axes: Axes, s: FloatArray, state: IntArray) -> None:
    """Draw the state of each point, from the middle before to the middle after the point."""
    middle = 0.5 * (s[1:] + s[:-1])
    edges = np.concatenate([s[:1], middle, s[-1:]])
    axes.pcolormesh(edges, [0.0, 1.0], state[None, :], cmap=style.STATES, vmin=-0.5, vmax=2.5)
