"""Values as plain JSON types, and their text; importing this costs nothing, so the command line can."""

import json
import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any


def to_json(document: Any) -> str:
    """Return JSON text that every reader takes: infinities and NaN become null."""
    return json.dumps(plain(document), indent=1, ensure_ascii=False, allow_nan=False)


def plain(value: Any) -> Any:
    """Return a value made of JSON types only; an object of data is a mapping of its fields."""
    if is_dataclass(value):
        return plain(vars(value))
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
