"""Cases of a test that repeat in detail what its faster cases show."""

from __future__ import annotations

from typing import Any

import pytest


def slow(*values: Any) -> Any:
    """A case with these values among those of ``parametrize``; `make test-all` runs it."""
    return pytest.param(*values, marks=pytest.mark.slow)
