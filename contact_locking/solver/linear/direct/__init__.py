"""The parallel direct solver; the rest of the package uses these two names only."""

from .substructuring import SPARE_MEMORY, Substructuring

__all__ = ["SPARE_MEMORY", "Substructuring"]
