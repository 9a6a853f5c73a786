"""What can be proved about a solution, and about how many there are; the core does without."""
