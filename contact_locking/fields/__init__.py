"""Values that depend on place and time: the clock, tables, and what the sampling of data sees."""
