"""The cell file's page explains every key that its model has."""

import re
from pathlib import Path

from pydantic import BaseModel

from workbench.robot import cell_file


def test_every_key_of_the_cell_file_is_explained() -> None:
    text = (Path(__file__).parents[2] / "data" / "robot" / "README.md").read_text()
    parts = [part for part in vars(cell_file).values() if isinstance(part, type) and issubclass(part, BaseModel)]
    keys = {key for part in parts for key in part.model_fields}
    assert len(keys) > 30
    told = {key for line in text.splitlines() if line.startswith("- ") for key in re.findall(r"`(\w+)`", line)}
    assert sorted(keys - told) == []
