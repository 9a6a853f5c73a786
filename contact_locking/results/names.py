"""The names of the files in the folder of a run."""

from __future__ import annotations

SUMMARY, PARAMETERS, FIELDS = "summary.json", "parameters.yaml", "fields.bp"
CONTACT, FACETS = "contact.csv", "contact_facets.csv"


def not_writable(directory: object) -> str:
    """The words for a folder that results cannot be written to; a long path is shortened."""
    path = str(directory)
    shown = path if len(path) <= 300 else f"{path[:200]}...{path[-80:]}"
    return f"results cannot be written to {shown}"
