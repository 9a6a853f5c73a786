"""Nonlinear strategies.  Each takes a discrete system, leaves the solution in it, and reports."""

from contact_locking.solver.saved import SavedState
from contact_locking.solver.settings import Settings
from contact_locking.solver.solver_report import SolverReport
from contact_locking.solver.strategy import METHODS, solve
from contact_locking.solver.task import Task

__all__ = ["METHODS", "SavedState", "Settings", "SolverReport", "Task", "solve"]
