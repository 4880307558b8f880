"""What a `toolpath.json` says of its own check, as far as it can be believed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.artefacts import Gate
from workbench.errors import InputError
from workbench.strict_json import content_digest

MOST, LONGEST = 10, 2000  # texts, and characters of one: a program repeats them
EXPECTED = "expected an object with passed, reason, loosened, unchecked and sha256"


def read_claim(document: Mapping[str, Any], where: str) -> Gate | None:
    """The decision in a file; a refusal where the path is no longer the one that was checked; None: it tells none.

    Raises:
        InputError: not such an entry.
    """
    if "check" not in document:
        return None
    check, where = document["check"], f"{where}.check"
    if not isinstance(check, dict) or type(check.get("passed")) is not bool:
        raise InputError(where, EXPECTED)
    reason, *_ = _texts([check.get("reason")], f"{where}.reason")
    loosened, unchecked = (_texts(check.get(key), f"{where}.{key}") for key in ("loosened", "unchecked"))
    if check.get("sha256") != content_digest({key: part for key, part in document.items() if key != "check"}):
        return Gate(False, "the path was changed after its check")
    return Gate(check["passed"], reason, loosened, unchecked)


def _texts(value: Any, where: str) -> tuple[str, ...]:
    if isinstance(value, list) and len(value) <= MOST and all(isinstance(x, str) and len(x) <= LONGEST for x in value):
        return tuple(value)
    raise InputError(where, f"expected texts, {MOST} of {LONGEST} characters at most")
