"""Nonlinear strategies.  Each takes a discrete system, leaves the solution in it, and reports."""

from contact_locking.solver.report import Settings, SolverReport
from contact_locking.solver.saved import SavedState
from contact_locking.solver.strategy import METHODS, solve

__all__ = ["METHODS", "SavedState", "Settings", "SolverReport", "solve"]
