"""Expressions of the study file: read through a whitelist, evaluated by NumPy or turned into UFL.

========== ==================================================================
numbers    ``2``, ``0.5``, ``1e-3``, ``pi``, ``e`` (and ``inf`` where a value may be infinite)
operators  ``+ - * / **``, and ``< <= > >= == != and or not`` inside conditions
choice     ``a if condition else b``
functions  those of `FUNCTIONS`
tables     ``name(argument)`` with the name of a `Table`
========== ==================================================================
"""

from .operations import CONSTANTS, FUNCTIONS, MAX_DEPTH, MAX_LENGTH, POSITION, TIME
from .parsing import parse
from .tree import NO_TABLES, Expression, Lookup, Table

__all__ = [
    "CONSTANTS",
    "FUNCTIONS",
    "MAX_DEPTH",
    "MAX_LENGTH",
    "NO_TABLES",
    "POSITION",
    "TIME",
    "Expression",
    "Lookup",
    "Table",
    "parse",
]
