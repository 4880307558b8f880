"""Result files of the plug-in as strict JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def strict_json(document: Mapping[str, Any]) -> bytes:
    """One member a line; arrays as lists, what is not finite as null."""
    members = (f"{json.dumps(key)}: {json.dumps(_plain(value), allow_nan=False)}" for key, value in document.items())
    return ("{\n  " + ",\n  ".join(members) + "\n}\n").encode()


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
