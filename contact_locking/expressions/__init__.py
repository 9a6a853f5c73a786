"""Expressions of the study file: read through a whitelist, evaluated by NumPy or turned into UFL.

========== ==================================================================
numbers    ``2``, ``0.5``, ``1e-3``, ``pi``, ``e`` (and ``inf`` where a value may be infinite)
operators  ``+ - * / **``, and ``< <= > >= == != and or not`` inside conditions
choice     ``a if condition else b``
functions  those of `FUNCTIONS`
========== ==================================================================
"""

from .grammar import (
    CONSTANTS,
    FUNCTIONS,
    LARGEST,
    MAX_DEPTH,
    MAX_LENGTH,
    POSITION,
    SMALLEST,
    TIME,
)
from .parsing import parse
from .tree import Expression

__all__ = [
    "CONSTANTS",
    "FUNCTIONS",
    "LARGEST",
    "MAX_DEPTH",
    "MAX_LENGTH",
    "POSITION",
    "SMALLEST",
    "TIME",
    "Expression",
    "parse",
]
