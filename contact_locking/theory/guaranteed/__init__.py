"""Proofs by exactly equilibrated stresses in 2D: a bound of the error, and of the limit load."""
