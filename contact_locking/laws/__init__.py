"""The laws as formulae.  No law knows a mesh or a solver."""
