"""Expressions of the study file: read through a whitelist, evaluated by NumPy or turned into UFL.

========== ==================================================================
numbers    ``2``, ``0.5``, ``1e-3``, ``pi``, ``e`` (and ``inf`` where a value may be infinite)
operators  ``+ - * / **``, and ``< <= > >= == != and or not`` inside conditions
choice     ``a if condition else b``
functions  those of `FUNCTIONS`
tables     ``name(argument)`` with the name of a `Table`
========== ==================================================================
"""

from .parsing import parse as parse
from .tree import CONSTANTS as CONSTANTS
from .tree import FUNCTIONS as FUNCTIONS
from .tree import MAX_DEPTH as MAX_DEPTH
from .tree import MAX_LENGTH as MAX_LENGTH
from .tree import NO_TABLES as NO_TABLES
from .tree import POSITION as POSITION
from .tree import TIME as TIME
from .tree import Expression as Expression
from .tree import Lookup as Lookup
from .tree import Table as Table
