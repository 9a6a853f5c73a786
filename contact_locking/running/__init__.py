"""Runs and studies of study files, which leave folders with their results."""
