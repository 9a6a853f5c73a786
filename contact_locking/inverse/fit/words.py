"""The result of a fit, and the doubts about it, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import chi2

from contact_locking.arrays import FloatArray
from contact_locking.plain_text import count, per_cent

from . import estimate
from .estimate import UNDETERMINED, Combination, Estimate

# Powers below this share are left out of the name of a combination.
_SMALL = 0.2
# Data and model that differ by this factor have other units.
_OTHER_UNITS = 1e3
# Residuals change their sign so much less often than noise, in standard deviations, if the model
# lacks something.  It tells where they are this share of the largest of the data.
_TOO_FEW, _NOISE = 2.6, 1e-3
# Misfits that differ by this share are of the same end.
_SAME = 0.01
# Residuals that noise would make so rarely are no noise.
_BY_CHANCE = 1e-3


def combination_name(combination: Combination, keys: Sequence[str]) -> str:
    """``young^0.71 mu^-0.70``, the largest power positive."""
    # Of powers that are the same but for rounding, the first is the largest.
    size = np.round(np.abs(combination.powers), 6)
    powers = combination.powers * np.sign(combination.powers[np.argmax(size)])
    order = [i for i in np.argsort(-size, kind="stable") if size[i] >= _SMALL]
    if len(order) == 1:
        return keys[order[0]]
    return " ".join(f"{keys[i]}^{powers[i]:.2f}" for i in order)


def undetermined(found: Estimate, keys: Sequence[str]) -> list[str]:
    """The numbers that the data bound on one side, and the combinations that they leave open."""
    bounds = [one_bound(float(low), float(high)) for low, high in found.intervals]
    one_sided = {key: bound for key, bound in zip(keys, bounds, strict=True) if bound}
    told = [f"{key}: {bound}; beyond, the misfit is flat" for key, bound in one_sided.items()]
    least = estimate.NO_INFLUENCE * found.combinations[0].singular
    for one in found.combinations:
        name, is_open = combination_name(one, keys), not one.error <= UNDETERMINED
        if np.isinf(found.scatter):
            # Without residuals there is no noise to tell.
            is_open = one.singular <= least
        if is_open and name not in one_sided:
            error = "the data do not depend on it"
            if np.isfinite(one.error):
                error = f"its standard error is {per_cent(one.error)}"
            told.append(f"{name}: {error}")
    return told


def one_bound(low: float | None, high: float | None) -> str:
    """``at least 0.18``, for an interval that is open on one side; empty for all others."""
    has_low, has_high = (end is not None and bool(np.isfinite(end)) for end in (low, high))
    if has_low == has_high:
        return ""
    return f"at least {low:.5g}" if has_low else f"at most {high:.5g}"


def about_units(column: str, data: FloatArray, model: FloatArray) -> list[str]:
    """Whether data and model at the start have magnitudes or signs that do not belong together."""
    given, found = (float(np.max(np.abs(values), initial=0.0)) for values in (data, model))
    if found == 0.0 and given > 0.0:
        return [f"{column}: the model has 0 at the start; does the body touch?"]
    if float(data @ model) < 0.0:
        return [f"{column}: the data and the model at the start have opposite signs"]
    if given > 0.0 and not 1.0 / _OTHER_UNITS < given / found < _OTHER_UNITS:
        return [
            f"{column}: the largest of the data is {given:.3g}, and the model has {found:.3g} at "
            "the start; are the units the same?"
        ]
    return []


def about_starts(starts: Sequence[Mapping[str, Any]], misfit: float) -> list[str]:
    """Whether several searches end where the best of them does."""
    ends = [row["misfit"] for row in starts]
    here = sum(end is not None and end <= (1.0 + _SAME) * misfit for end in ends)
    nowhere = sum(end is None for end in ends)
    if here == len(ends):
        return []
    told = [f"{here} of {len(ends)} searches ended at the least misfit"]
    if elsewhere := len(ends) - here - nowhere:
        told.append(f"{elsewhere} at other numbers with larger ones")
    if nowhere:
        told.append(f"{nowhere} without a solution")
    return [", ".join(told)]


def about_residuals(
    column: str, residuals: FloatArray, data: FloatArray, sigma: FloatArray | None, free: float
) -> list[str]:
    """Whether the residuals (k,) are noise, with standard errors if they are known.

    ``free`` is the share of the data that no fitted number has used up.
    """
    told = []
    if sigma is not None:
        total, freedom = float(np.sum((residuals / sigma) ** 2)), free * len(residuals)
        if freedom > 0.0 and chi2.sf(total, freedom) < _BY_CHANCE:
            told.append(
                f"{column}: the residuals are {np.sqrt(total / freedom):.1f} times their standard "
                "errors; the model lacks something, or the errors are larger"
            )
    size = float(np.sqrt(np.mean(residuals**2)))
    signs = np.sign(residuals[residuals != 0.0])
    changes, noise = int(np.sum(signs[1:] != signs[:-1])), 0.5 * max(len(signs) - 1, 0)
    too_few = changes < noise - _TOO_FEW * np.sqrt(0.5 * noise)
    if too_few and size > _NOISE * float(np.max(np.abs(data))):
        told.append(
            f"{column}: the residuals change their sign {changes} times, noise would do so about "
            f"{noise:.0f} times; the model lacks something, or its steps are too coarse"
        )
    return told


def rows(found: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """The table of a terminal, of the content of fit.json."""
    table: list[tuple[str, ...]] = []
    has_scatter = found["scatter"] is not None and bool(np.isfinite(found["scatter"]))
    for key, entry in found["parameters"].items():
        error, (low, high) = entry["standard_error"], entry["interval"]
        if bound := one_bound(low, high):
            told, between = bound, "95 %"
        elif error is None or not np.isfinite(error):
            told = "not determined" if has_scatter else "no standard error"
            between = ""
        else:
            told, between = f"± {error:.2g}", f"95 %: {low:.5g} to {high:.5g}"
        place = "at a bound" if entry["at_bound"] else ""
        table.append((key, f"{entry['value']:.6g}", told, between, place))
    numbers = sum(len(curve["data"]) for curve in found["curves"])
    told = count(found["evaluations"], "evaluation")
    table.append(("misfit", f"{found['misfit']:.4g}", f"of {numbers} numbers", told, ""))
    return table
