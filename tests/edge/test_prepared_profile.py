"""Which preparation it is, by how its faces fall."""

import pytest

from workbench.edge.prepared_profile import kind_of
from workbench.units import DEG


@pytest.mark.parametrize(
    ("falls", "kind"),
    [
        ([50.0], "bevel"),
        ([30.0, 50.0], "compound"),
        ([50.0, 30.0], "compound"),
        ([50.0, 51.0], None),
        ([50.0, 1.0], "nose"),
        ([80.0, 60.0, 40.0, 20.0, 2.0], "J"),
        ([80.0, 60.0, 70.0], None),
        ([89.9], None),
        ([], None),
    ],
)
def test_faces_that_fall_so_are_such_a_preparation(falls: list[float], kind: str | None) -> None:
    assert kind_of([fall * DEG for fall in falls]) == kind
