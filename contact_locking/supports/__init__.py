"""Displacement conditions, supports along directions, and the rigid motions that they leave."""
