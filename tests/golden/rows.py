"""Print the rows of the verification table that a file of tests finds, a line of JSON for each."""

from __future__ import annotations

import collections
import json
import sys
from typing import Any

import pytest


class Rows:
    """The rows at the end of a session."""

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        conftest: Any = sys.modules["conftest"]
        seen: collections.Counter[str] = collections.Counter()
        print()
        for row in conftest.ROWS:
            name = f"{row.id} {row.problem}: {row.quantity}"
            seen[name] += 1
            count = f" ({seen[name]})" if seen[name] > 1 else ""
            print(json.dumps([name + count, float(row.computed), row.exact]))


if __name__ == "__main__":
    pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]], plugins=[Rows()])
