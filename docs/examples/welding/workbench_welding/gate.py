"""`weld.gate`: the pipeline's decision on the groove."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from workbench.api import Gate, stage
from workbench_welding.groove import Groove


@stage("weld.gate")
def gate(
    groove: Groove,
    *,
    reject: Annotated[tuple[Literal["fail", "undecided"], ...], Field(description="verdicts that reject the part")] = (
        "fail",
    ),
) -> Gate:
    """Reject the part if its groove's verdict is one of `reject`: the exit status of the run is then 1."""
    return Gate(groove.verdict not in reject, f"{groove.verdict}: {groove.reason}")
