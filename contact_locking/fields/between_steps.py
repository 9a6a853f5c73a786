"""The course of data between the steps of a process, which sees them at its steps alone."""

from __future__ import annotations

import itertools

import numpy as np

from contact_locking.arrays import AXES, FloatArray
from contact_locking.expressions import TIME
from contact_locking.fields.clock import Clock
from contact_locking.values.value import Value

# Each step is divided into so many parts, and each side of the body, too.
_PARTS, _PLACES = 16, 5
# Data may leave the range of their values at both ends of a step by this share of their size.
_PEAK = 0.2
# A mean below this share of the values that it is of is zero with rounding.
_ROUNDING = 1e-12


def unseen_peaks(value: Value, key: str, clock: Clock, box: FloatArray) -> list[str]:
    """A warning about data with a peak that no step sees.

    The mean over points in the ``box`` (2, d) around the body is looked at, so that a load that
    travels has no peak.  Tables over t are looked at in all of their rows.
    """
    expression = value.expression
    if expression is None or not value.is_timed or not clock.planned:
        return []
    lattice = np.meshgrid(*(np.linspace(low, high, _PLACES) for low, high in box.T))
    places = dict(zip(AXES, (axis.reshape(-1, 1) for axis in lattice), strict=False))
    rows = [item.table.points for item in expression.lookups if item.is_over(TIME)]
    knots = np.unique(np.concatenate([np.zeros(0), *rows]))
    ends = [clock.start, *(time for time in clock.planned if time > clock.start)]
    largest, rounding, worst = 0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0)
    for before, after in itertools.pairwise(ends):
        inside = knots[(knots > before) & (knots < after)]
        times = np.sort(np.append(np.linspace(before, after, _PARTS + 1), inside))
        values = expression.unchecked(**places, **{TIME: times})
        values = values[np.all(np.isfinite(values), axis=1)]
        if not len(values):
            continue
        rounding = max(rounding, _ROUNDING * float(np.abs(values).max()))
        values = values.mean(axis=0)
        low, high = sorted((values[0], values[-1]))
        beyond = np.maximum(values - high, low - values)
        largest, most = max(largest, float(np.abs(values).max())), int(np.argmax(beyond))
        worst = max(worst, (beyond[most], times[most], values[most], before, after))
    beyond_most, time, mean, before, after = worst
    if beyond_most <= max(_PEAK * largest, rounding):
        return []
    return [
        f"{key}: its mean is {mean:.3g} at t = {time:.6g}, which no step sees: the steps go from "
        f"{before:.6g} to {after:.6g}; add the time to steps.times"
    ]
