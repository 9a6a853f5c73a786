"""Derivatives of solutions, and fits of numbers to measurements; the core does without."""
