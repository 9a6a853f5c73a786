"""Contacts: the surface, the foundation, friction with its smoothing, and free foundations."""
