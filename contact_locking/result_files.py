"""The names of what a run writes into its folder, for those who write it and those who read it."""

from __future__ import annotations

SUMMARY, PARAMETERS, FIELDS = "summary.json", "parameters.yaml", "fields.bp"
CONTACT, FACETS = "contact.csv", "contact_facets.csv"

# What is said of a folder where they cannot be.
NOT_WRITABLE = "results cannot be written to {}"
