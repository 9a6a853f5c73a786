"""Equilibria as fixed points of the map of the friction bounds, which is small."""
