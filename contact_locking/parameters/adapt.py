"""Adaptive meshes: how accurate the solution shall be, and when to give up."""

from __future__ import annotations

from typing import Literal

from .base import Section, entry
from .values import Count, Share, Tolerance


class AdaptParameters(Section):
    """The loop that solves, estimates the error, marks cells and refines them."""

    tolerance: Tolerance = entry(
        0.01, "the relative error in the energy norm at which the meshes are fine enough", "1"
    )
    by: Literal["estimate", "bound"] = entry(
        "estimate",
        "the error that is meant and that marks cells: estimate (certificate.errors.mesh) or bound "
        "(certificate.errors.guaranteed)",
    )
    share: Share = entry(0.5, "the share of the squared error that the marked cells have", "1")
    max_dofs: Count = entry(100_000, "no mesh has more unknowns", "1")
    max_meshes: Count = entry(12, "no more meshes, with the first", "1")
