"""Fits of numbers of a study file to measured curves."""

from __future__ import annotations

from .curves import read_experiments
from .session import fit

__all__ = ["fit", "read_experiments"]
