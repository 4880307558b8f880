"""Writes the arrays of a recording in the various forms that the format allows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

FORMS: dict[str, dict[str, Any]] = {
    "plain": {},
    "gzip": {"chunks": True, "compression": "gzip", "compression_opts": 1, "shuffle": True},
    "lzf": {"chunks": True, "compression": "lzf"},
    "checked": {"chunks": True, "fletcher32": True},
}


def write(
    path: Path,
    arrays: dict[str, np.ndarray],
    *,
    form: str = "plain",
    without: tuple[str, ...] = (),
    attributes: dict[str, Any] | None = None,
    byte_texts: bool = False,
) -> Path:
    """Write a recording; `without` leaves optional data sets out."""
    texts = {"format": "profile-recording", "length_unit": "mm", "time_unit": "s"} | (attributes or {})
    with h5py.File(path, "w") as file:
        for name, value in texts.items():
            file.attrs[name] = np.bytes_(value) if byte_texts and isinstance(value, str) else value
        file.attrs["version"] = (attributes or {}).get("version", 1)
        for name, array in arrays.items():
            if name not in without:
                options = FORMS[form] if np.ndim(array) and len(array) > 4 else {}
                file.create_dataset(name, data=array, **options)
    return path
