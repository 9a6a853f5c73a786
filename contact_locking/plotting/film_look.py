"""What all frames of a film have in common: the magnification and the scale of the colours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from matplotlib.colors import Normalize

from contact_locking.plotting import style
from contact_locking.plotting.snapshot import Snapshot

# Inches, and pixels to an inch, of the pictures of bodies in three dimensions.
FILM_WIDTH, FILM_DPI = 4.4, 120


@dataclass(frozen=True)
class Look:
    """The factor of the displacement, and for each body the values of its cells on one scale."""

    factor: float
    shades: tuple[style.Shade, ...]


def look_of(bodies: Sequence[Snapshot]) -> Look:
    """The look of a film with these bodies, the same wherever it is drawn."""
    shades = [style.shade(body) for body in bodies]
    top = max(float(shade.norm.vmax or 0.0) for shade in shades)
    extend = "max" if any(shade.extend == "max" for shade in shades) else "neither"
    return Look(
        min(style.magnification(body) for body in bodies),
        tuple(replace(shade, norm=Normalize(0.0, top), extend=extend) for shade in shades),
    )
