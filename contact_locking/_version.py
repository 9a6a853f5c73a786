"""The version of this package, which results and checkpoints carry."""

__version__ = "0.3.0"
