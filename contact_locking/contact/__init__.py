"""Contacts: the surface, the foundation, friction with its smoothing, and pushed foundations."""
