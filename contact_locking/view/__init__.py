"""Pictures, charts and pages of results; the core does without."""
