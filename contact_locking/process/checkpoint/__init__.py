"""Solved states in files, which any number of ranks can read on the same mesh."""
