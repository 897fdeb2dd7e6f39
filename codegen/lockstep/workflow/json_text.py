"""JSON that every reader takes, as all files and answers are written."""

import json
import math
from collections.abc import Mapping
from typing import Any


def to_json(document: Any) -> str:
    """Return JSON text that every reader takes: infinities and NaN become null.

    >>> print(to_json({"margin": float("nan"), "pairs": ((1, 2),)}).replace("\\n", ""))
    { "margin": null, "pairs": [  [   1,   2  ] ]}
    """
    return json.dumps(plain(document), indent=1, ensure_ascii=False, allow_nan=False)


def plain(value: Any) -> Any:
    """Return a value made of JSON types only."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
