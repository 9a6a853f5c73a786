"""The names of what a run writes into its folder, for those who write it and those who read it."""

from __future__ import annotations

SUMMARY, PARAMETERS, FIELDS = "summary.json", "parameters.yaml", "fields.bp"
CONTACT, FACETS = "contact.csv", "contact_facets.csv"


def not_writable(directory: object) -> str:
    """What is said of a folder where they cannot be; of a long path its ends."""
    path = str(directory)
    shown = path if len(path) <= 300 else f"{path[:200]}...{path[-80:]}"
    return f"results cannot be written to {shown}"
