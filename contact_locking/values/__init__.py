"""The base class of concepts, and the kinds of their values."""
