"""What a `toolpath.json` says of its own check, as far as it can be believed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.artefacts import Check, Gate
from workbench.errors import InputError
from workbench.strict_json import content_digest

MOST_CHECKS = 100
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


def read_evidence(document: Mapping[str, Any], where: str) -> tuple[Check, ...]:
    """The checks that a file says its path rests on; none where it tells none.

    Raises:
        InputError: not a list of checks.
    """
    rows, where = document.get("evidence", []), f"{where}.evidence"
    if not isinstance(rows, list) or len(rows) > MOST_CHECKS:
        raise InputError(where, f"expected a list of {MOST_CHECKS} checks at most")
    return tuple(_check(row, f"{where}[{i}]") for i, row in enumerate(rows))


def _check(row: Any, where: str) -> Check:
    expected = "expected an object with name, value, limit, passed and reason"
    if not isinstance(row, dict) or type(row.get("passed")) is not bool:
        raise InputError(where, expected)
    name, reason, finding = _texts([row.get("name"), row.get("reason"), row.get("finding", "")], where)
    value, limit = row.get("value"), row.get("limit")
    both = limit if isinstance(limit, list) and len(limit) == 2 else [limit]
    if not all(one is None or (type(one) in (int, float) and abs(one) < 1e300) for one in [value, *both]):
        raise InputError(where, expected)
    bounds: Any = tuple(both) if len(both) == 2 else limit
    return Check(name, value, bounds, row["passed"], reason, finding, row.get("loosened") is True)


def _texts(value: Any, where: str) -> tuple[str, ...]:
    if isinstance(value, list) and len(value) <= MOST and all(isinstance(x, str) and len(x) <= LONGEST for x in value):
        return tuple(value)
    raise InputError(where, f"expected texts, {MOST} of {LONGEST} characters at most")
