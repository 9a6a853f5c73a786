"""Values that depend on place and time: the clock, tables, and the sampling of data."""
