"""Rows of the table about the posture optimiser."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.speed.timing import Row, alone, seconds


def postures() -> Iterator[Row]:
    """Traversal, proven optimum and single postures, in a process on one core."""
    yield from traversed(alone("postures"))


def traversed(found: dict[str, Any]) -> Iterator[Row]:
    """Rows of what `bench.speed.postures` has measured."""
    count = 360 * 360 * found["points"] * found["branches"]
    each_s = found["traversal_s"] / count
    size = f"360 x 360 angles x {found['points']} points, all {found['branches']} branches of the arm"
    yield Row(
        f"traversal of {size}, no collision",
        seconds(found["traversal_s"]),
        "",
        found["traversal_s"],
        "{:.2f} s",
        goal=0.5,
        at_most=True,
    )
    yield Row(
        "postures of it a second: kinematics, limits, displacement",
        f"{1e-6 / each_s:.3g} M",
        "",
        1e-6 / each_s,
        "{:.0f} M",
        goal=20,
    )
    for name, goal in (("open", 3), ("cluttered", 10)):
        cells = found[f"{name}_cells"]
        yield Row(
            f"the optimum with exact collision checks, proven, {name} cell ({cells:,} cells examined)",
            seconds(found[f"{name}_s"]),
            "",
            found[f"{name}_s"],
            "{:.2f} s",
            goal,
            at_most=True,
        )
    yield Row(
        f"postures a second with a certified clearance ({found['certified']:.0%} proven free)",
        f"{1e-6 / found['bound_s']:.3g} M",
        "",
        1e-6 / found["bound_s"],
        "{:.2f} M",
        goal=0.5,
    )
    yield Row(
        f"postures a second, the doubtful ones by fcl ({found['colliding']:.0%} collide)",
        f"{1e-6 / found['screen_s']:.3g} M",
        "",
        1e-6 / found["screen_s"],
        "{:.3f} M",
    )
