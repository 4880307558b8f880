"""docs/importing_bags.md says what the mapping takes."""

import json
import re
from pathlib import Path

from workbench.importing.mapping import read_mapping
from workbench.importing.mapping_parts import BagPart

PAGE = (Path(__file__).parents[2] / "docs" / "importing_bags.md").read_text(encoding="utf-8")


def test_the_examples_are_mappings(tmp_path: Path) -> None:
    examples = re.findall(r"```json\n(.*?)```", PAGE, re.DOTALL)
    assert len(examples) == 2
    for text in examples:
        (tmp_path / "map.json").write_text(text)
        part = read_mapping(tmp_path / "map.json").bag
        assert part is not None
        assert part.model_dump(exclude_unset=True) == json.loads(text)["bag"]


def test_every_key_is_explained() -> None:
    lines = [line for line in PAGE.splitlines() if line.startswith("- `")]
    for key in BagPart.model_fields:
        assert any(f"`{key}`" in line.partition(": ")[0] for line in lines), key
