"""Proofs by exactly equilibrated stresses in 2D: a bound of the error, and of the limit load."""

from contact_locking.theory.guaranteed.energy_bound import guaranteed_error
from contact_locking.theory.guaranteed.limit_load import limit_load

__all__ = ["guaranteed_error", "limit_load"]
