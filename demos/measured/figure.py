"""Draw a fit to measured forces beside formulas for a rigid tip: figure.py RESULTS PICTURE.

RESULTS is the folder of `contact-locking fit demos/measured/tip.yml`.  Both formulas are for a half
space, E* = E/(1 - nu^2), tips of radius R and depths d:

    F = 4/3 E* sqrt(R) d^1.5                                        H. Hertz (1882), a paraboloid
    F = E* ((a^2 + R^2)/2 L - a R),  d = a L/2,  L = ln((R + a)/(R - a))
                                          I. N. Sneddon, Int. J. Eng. Sci. 3 (1965) 47-57, a sphere
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from scipy.optimize import curve_fit

RADIUS, POISSON = 27.5, 0.45


def hertz(d: Any) -> Any:
    """F/E* of a paraboloid."""
    return 4.0 / 3.0 * np.sqrt(RADIUS) * np.maximum(d, 0.0) ** 1.5


def sneddon(d: Any) -> Any:
    """F/E* of a sphere."""
    a = np.linspace(1e-6, 0.95 * RADIUS, 5000)
    log = np.log((RADIUS + a) / (RADIUS - a))
    return np.interp(d, 0.5 * a * log, 0.5 * (a**2 + RADIUS**2) * log - a * RADIUS)


def tell(name: str, values: Any, errors: Any) -> None:
    """Print modulus and start with their standard errors."""
    pairs = zip(("E*", "start"), values, errors, strict=True)
    print(f"{name:8}", *(f"{key} {value:.4f} +- {error:.4f}" for key, value, error in pairs))


def main(results: str, picture: str) -> None:
    """Print the moduli and draw the picture."""
    found = json.loads((Path(results) / "fit.json").read_text())
    curve = found["curves"][0]
    t, force, model = (np.array(curve[name]) for name in ("over", "data", "model"))
    entries = found["parameters"].values()
    values, errors = (
        np.array([entry[name] for entry in entries]) / (1.0 - POISSON**2, 1.0)
        for name in ("value", "standard_error")
    )
    tell("model", values, errors)
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(6.4, 5.6), sharex=True, height_ratios=(3, 1), layout="constrained"
    )
    above.plot(t, force, "o", color="black", label="measured")
    above.plot(t, model, color="C0", label=f"model, E* = {values[0]:.3f} kPa")
    below.axhline(0.0, color="0.7", lw=0.8)
    below.plot(t, model - force, "-o", ms=3, color="C0")
    fine = np.linspace(t[0], t[-1], 200)
    for name, law, style in (("Hertz", hertz, "--"), ("Sneddon", sneddon, ":")):

        def formula(x: Any, modulus: float, touch: float, law: Any = law) -> Any:
            return modulus * law(x - touch)

        best, covariance = curve_fit(formula, t, force, p0=(0.15, 2.0))
        tell(name, best, np.sqrt(np.diag(covariance)))
        label = f"{name}, E* = {best[0]:.3f} kPa"
        above.plot(fine, formula(fine, *best), style, color="C1", label=label)
        below.plot(t, formula(t, *best) - force, style, color="C1")
    above.set_ylabel("force [nN]")
    above.legend(frameon=False)
    below.set(xlabel="way of the tip t [µm]", ylabel="residual [nN]")
    figure.savefig(picture)


if __name__ == "__main__":
    main(*sys.argv[1:])
