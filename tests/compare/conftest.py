"""Charts of the comparisons."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def charts(undrawn: None) -> None:
    """Nobody here looks at them."""
