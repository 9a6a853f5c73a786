"""Coulomb's friction: for the whole of Gamma_C, and what one part of Gamma_C says differently."""

from __future__ import annotations

from typing import Literal

from .base import Section, entry
from .values import NonNegative, NonNegativeSlipScalar, Positive

Kernel = Literal["convolution", "helmholtz", "none"]


class Smoothing(Section):
    """R, the mollifier of the normal stress along Gamma_C."""

    kernel: Kernel = entry(
        "convolution", "convolution, helmholtz (I - r^2 Laplace_Gamma), or none: local Coulomb"
    )
    radius: Positive | None = entry(
        None,
        "r, of the kernel, measured along Gamma_C; null: a tenth of the extent of Gamma_C, two "
        "facets at least",
        "length",
    )


class FrictionParameters(Section):
    """Coulomb's law (6): |sigma_tau| <= mu(|u_tau|) |R sigma_nu|."""

    coefficient: NonNegativeSlipScalar = entry(
        0.0, "mu >= 0, a number or an expression of x, y, z and s = |u_tau|", "1", scalar="s"
    )
    smoothing: Smoothing = entry(Smoothing(), "the mollifier R")
    regularisation: NonNegative | None = entry(
        None,
        "the slip at which friction reaches 71 % of its bound, eps of (22); 0: Coulomb's law "
        "itself, without regularisation; null: penalty.epsilon times Young's modulus",
        "length",
    )


class OwnSmoothing(Section):
    """The mollifier R of one part of Gamma_C, as far as it differs from ``friction.smoothing``."""

    kernel: Kernel | None = entry(None, "null: friction.smoothing.kernel", optional=True)
    radius: Positive | None = entry(
        None, "null: friction.smoothing.radius", "length", optional=True
    )


class OwnFriction(Section):
    """The friction of one part of Gamma_C, as far as it differs from ``friction``."""

    coefficient: NonNegativeSlipScalar | None = entry(
        None, "null: friction.coefficient", "1", scalar="s", optional=True
    )
    smoothing: OwnSmoothing | None = entry(None, "the mollifier R of this part", optional=True)
    regularisation: NonNegative | None = entry(
        None, "null: friction.regularisation", "length", optional=True
    )

    def over(self, common: FrictionParameters) -> FrictionParameters:
        """``common``, with the keys that this part gives itself in place of the common ones."""
        own = self.model_dump(exclude_none=True)
        smoothing = common.smoothing.model_copy(update=own.pop("smoothing", {}))
        return common.model_copy(update={**own, "smoothing": smoothing})
