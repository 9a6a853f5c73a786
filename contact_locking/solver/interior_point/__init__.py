"""A primal-dual interior point method for the contact problem, for any n up to infinity."""

from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.interior_point.tuning import Tuning

__all__ = ["InteriorPoint", "Tuning"]
