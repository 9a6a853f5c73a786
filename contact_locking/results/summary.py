"""The summary of a solve as JSON."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def summary_text(summary: dict[str, Any]) -> str:
    """The summary as JSON.

    JSON has no infinity and no NaN.  The value is null in their place, and the mapping
    ``not_finite`` gives the number under its dotted key.
    """
    not_finite: dict[str, str] = {}
    plain = _jsonable(summary, "", not_finite)
    if not_finite:
        plain["not_finite"] = not_finite
    return json.dumps(plain, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _jsonable(value: Any, key: str, not_finite: dict[str, str]) -> Any:
    match value:
        case dict():
            return {
                str(name): _jsonable(item, f"{key}.{name}" if key else str(name), not_finite)
                for name, item in value.items()
            }
        case list() | tuple() | np.ndarray():
            return [_jsonable(item, f"{key}.{i}", not_finite) for i, item in enumerate(value)]
        case np.generic():
            return _jsonable(value.item(), key, not_finite)
        case float() if not math.isfinite(value):
            not_finite[key] = str(value)
            return None
    return value
