"""The laws as formulae: they know neither a mesh nor a solver."""
