"""What every result file shares: numbers that are finite, reading and writing, refusals with their place."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError

from workbench.artefacts import UNKNOWN_PART, Part
from workbench.errors import InputError
from workbench.parameters import complaint
from workbench.strict_json import MAX_BYTES, read_json, strict_json

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Matrix = tuple[Quaternion, Quaternion, Quaternion, Quaternion]
Six = tuple[Number, Number, Number, Number, Number, Number]
Matrix6 = tuple[Six, Six, Six, Six, Six, Six]
Unknown = Number | None
UnknownU = NotNegative | None


class Row(BaseModel):
    """A part of a file; further keys are kept."""

    model_config = ConfigDict(extra="allow", frozen=True, defer_build=True)  # built when it is first used


class ResultFile(Row):
    """A result file."""

    NAME: ClassVar[str]
    ANOTHER: ClassVar[dict[str, str]] = {}  # by format: what is easily taken for this file, and what to give instead
    _document: dict[str, Any] = PrivateAttr(default_factory=dict)

    @property
    def document(self) -> dict[str, Any]:
        """All that the file that was read holds, keys of others included."""
        return self._document

    @classmethod
    def written(cls, content: Mapping[str, Any]) -> bytes:
        """The file's bytes: strict JSON that this model accepts. ValidationError: a defect of the caller."""
        made = strict_json(dict(content))
        cls.model_validate_json(made)
        return made

    @classmethod
    def read(cls, path: Path, max_bytes: int = MAX_BYTES) -> Self:
        """What a file says.

        Raises:
            InputError: it is no such file: the place in it and what was expected.
        """
        document = read_json(path, max_bytes)
        if another := cls.ANOTHER.get(str(document.get("format"))):
            raise InputError(f"{path}: $.format", f"expected a {cls.NAME}, found {another}")
        try:
            made = cls.model_validate_json(json.dumps(document), strict=True)
        except ValidationError as error:
            raise _refusal(error, document, path) from None
        made._document = document
        return made


class PartFile(ResultFile):
    """A result file that says whose result it is; of a robot, a tool or a table: by which robot, when, by whom."""

    part: Part = Field(default=UNKNOWN_PART, description="null: unknown; absent in files of earlier versions")


def _refusal(error: ValidationError, document: Mapping[str, Any], path: Path) -> InputError:
    """The first thing that is wrong: its place, what was expected, and the nearest known name."""
    found_wrong = error.errors(include_url=False)
    first = found_wrong[0]
    if first["type"] == "missing":
        *above, last = first["loc"]
        holder: Any = document
        for key in above:
            holder = holder[key]
        place = "$" + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in above)
        if isinstance(last, int):
            alike = (e["loc"][-1] for e in found_wrong if e["loc"][:-1] == first["loc"][:-1])
            most = max([last, *(k for k in alike if isinstance(k, int))])
            return InputError(f"{path}: {place}", f"expected {most + 1} entries, found {len(holder)}")
        near = difflib.get_close_matches(str(last), holder, n=1)
        return InputError(f"{path}: {place}", f"expected '{last}'" + (f", found '{near[0]}'" if near else ""))
    found = complaint(error, document, "$")
    return InputError(f"{path}: {found.where}", found.expected)
