"""`inspect.gate`: the pipeline's decision on the part."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from workbench.artefacts import Gate, Inspection
from workbench.stage import stage


@stage("inspect.gate")
def gate(
    inspection: Inspection,
    *,
    reject: Annotated[tuple[Literal["fail", "undecided"], ...], Field(description="verdicts that reject the part")] = (
        "fail",
    ),
) -> Gate:
    """Reject the part if its verdict is one of `reject`: the exit status of the run is then 1.

    Args:
        inspection: the judged part.
        reject: verdicts that reject it; by default only a proven failure does.
    """
    passed = inspection.verdict not in reject
    return Gate(passed, f"{inspection.verdict}: {inspection.reason}")
