"""Files that are not there: the name that was probably meant."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

from contact_locking.plain_text import nearest, printable

# To compare more names takes longer than a message should.
_MOST_NAMES = 1000


def similar(path: Path) -> str:
    """The hint at the file in the same folder whose name is most like that of ``path``."""
    try:
        with os.scandir(path.parent) as entries:
            names = [entry.name for entry in itertools.islice(entries, _MOST_NAMES)]
    except (OSError, ValueError):  # no folder, or a name that no folder can have
        return ""
    return printable(nearest(path.name, sorted(names)))
