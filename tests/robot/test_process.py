"""What of a program's process nobody looks at."""

from __future__ import annotations

from typing import Any

from workbench.robot import read_cell
from workbench.robot.process import not_seen


def test_a_table_that_is_free_at_home_may_come_from_anywhere(cell_file: Any) -> None:
    """A post on its rim meets the arm at some angle: then where the table stands is among what nobody looks at."""
    post = {"name": "post", "on": "turntable", "pose": {"position_mm": [-450, 0, 820]}, "box_mm": [80, 80, 2600]}
    for more, said in (([], "the robot stands to home"), ([post], "the robot and its external axes stand to home")):
        made = read_cell(cell_file(lambda tree, more=more: tree["fixtures"].extend(more)))
        assert next(not_seen(made, made.process, "abb")) == f"the way from where {said}"
