"""Fits of numbers of a study file to measured curves."""
