"""Distances between solutions, also on different meshes, and the rates at which they fall."""

from .distance import Norms, distance, norms
from .rates import fitted_rate
from .table import read_table, write_table

__all__ = ["Norms", "distance", "fitted_rate", "norms", "read_table", "write_table"]
