"""Cases that tell what another of their list tells as well, on a further part: run by `make test-slow` only."""

from __future__ import annotations

from typing import Any

import pytest


def seldom(*cases: Any) -> list[Any]:
    """Parameters of a test, a tuple each where they are several."""
    return [pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.slow) for one in cases]
