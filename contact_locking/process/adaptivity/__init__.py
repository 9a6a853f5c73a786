"""Meshes that are refined where the error is, until the solution is accurate enough."""

from contact_locking.process.adaptivity.adaptive_loop import solve, solve_adaptively

__all__ = ["solve", "solve_adaptively"]
