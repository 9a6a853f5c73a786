"""Golden numbers: what the program computes, which a change of its design must not change."""
