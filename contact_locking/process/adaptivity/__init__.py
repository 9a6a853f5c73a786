"""Meshes that are refined where the error is, until the solution is accurate enough."""
