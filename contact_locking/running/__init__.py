"""Runs that leave a folder with their results."""

from contact_locking.running.process import run_steps

__all__ = ["run_steps"]
