"""The discrete problem of a parameter set: everything that exists before the first solve."""
