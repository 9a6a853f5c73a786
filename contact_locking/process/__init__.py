"""Processes: the problem solved at several times, with friction that remembers the slip."""
