"""Values as plain JSON types, and their text; importing this costs nothing, so the command line can."""

import json
import math
from collections.abc import Mapping, Sequence
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
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def values_text(value: Any) -> str:
    """Return a value, or a list or table of them, for people.

    >>> values_text({"y1": 0.003, "y2": 3.0e-5}), values_text([0.002]), values_text(1.0), values_text(True)
    ('y1 0.003 y2 3e-05', '0.002', '1', 'yes')
    """
    if isinstance(value, Mapping):
        return " ".join(f"{name} {values_text(one)}" for name, one in value.items())
    if isinstance(value, bool | str):
        return value if isinstance(value, str) else "yes" if value else "no"
    return " ".join(map(values_text, value)) if isinstance(value, Sequence) else f"{value:g}"
