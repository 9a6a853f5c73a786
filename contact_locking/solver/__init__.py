"""Nonlinear strategies.  Each takes a discrete system, leaves the solution in it, and reports."""
