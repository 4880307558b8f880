"""`scan-plan.json`: the passes of a planned scan, and what they are predicted to tell."""

from __future__ import annotations

import hashlib
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from workbench.result_files.contract import NotNegative, Number, Positive, Quaternion, ResultFile, Row, Unknown, Vector


class ScanPoint(Row):
    """A pose of the profiler in the base, the part where it was planned."""

    arc_length_mm: Number
    position_mm: Vector
    quaternion_wxyz: Quaternion
    feed_mm_s: Positive | None = Field(default=None, description="the pass's speed")
    cutting: bool = False
    measured: bool = True
    joints_deg: tuple[Number, Number, Number, Number, Number, Number] | None = Field(
        default=None, description="null: no cell was named"
    )


class ScanPassRow(Row):
    """One pass."""

    index: Annotated[int, Field(ge=1)]
    elevation_deg: Number = Field(description="of the scanner above the root face's normal")
    lead_deg: Number
    standoff_mm: Positive
    speed_mm_s: Positive
    frame_pitch_mm: Positive
    drift_mm: Number = Field(description="by which the scanner moves across its view along the pass")
    turntable_deg: Unknown = Field(default=None, description="null: no turntable, or no cell")
    duration_s: Positive
    points: list[ScanPoint] = Field(min_length=2)


class PredictedColumns(Row):
    """Along the edge; null: no pass sees it. Medians over rehearsed scans, and what is promised."""

    arc_length_mm: list[Number]
    root_U_mm: list[Unknown]  # noqa: N815  (U is the symbol of GUM)
    bevel_U_deg: list[Unknown]  # noqa: N815  (U is the symbol of GUM)
    promised_root_U_mm: list[Unknown] = Field(  # noqa: N815
        default=[], description="that nine of ten scans stay within, whatever the rounding"
    )
    promised_bevel_U_deg: list[Unknown] = Field(default=[], description="likewise")  # noqa: N815
    reached: list[bool] = Field(description="whether what is promised is at most what is wanted")
    root_u_by_source_mm: dict[str, list[Unknown]]
    bevel_u_by_source_deg: dict[str, list[Unknown]]


class ScanPlanFile(ResultFile):
    """`scan-plan.json`: U is expanded by k = 2. Of no part yet: of the nominal joint and the declared priors."""

    NAME: ClassVar[str] = "scan-plan.json"
    format: Literal["scan-plan"]
    version: Literal[1]
    frame: Literal["base"]
    edge: str = Field(description="the file that gave the edge")
    thickness_mm: Positive
    root_mm: Positive
    bevel_deg: Positive
    edge_condition: Literal["sharp", "deburred", "unknown"]
    wanted_root_U_mm: Positive  # noqa: N815  (U is the symbol of GUM)
    wanted_bevel_U_deg: Positive  # noqa: N815  (U is the symbol of GUM)
    reached: bool
    duration_s: NotNegative
    columns: int | None = Field(default=None, description="of the profiler that it is planned for")
    passes: list[ScanPassRow]
    predicted: PredictedColumns
    binds: list[str] = Field(description="what keeps U from what is wanted, and where")
    would_help: list[str]
    not_checked: list[str]


def plan_id(content: bytes) -> str:
    """By which a recording names the `scan-plan.json` that it followed: the beginning of the file's SHA-256."""
    return hashlib.sha256(content).hexdigest()[:16]
