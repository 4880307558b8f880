"""A stage is an ordinary function whose parameters are checked, whoever calls it."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from pydantic import Field

from workbench.artefacts import Cloud, HandEye
from workbench.errors import PipelineError
from workbench.stage import REGISTRY, InputFile, Progress, Role, Seed, Stage, stage


def example(
    pose: HandEye,
    others: tuple[HandEye, ...] = (),
    cloud: Cloud | None = None,
    *,
    window_frames: Annotated[int, Field(ge=3, le=31)] = 5,
    limits_mm: tuple[float, float] = (-1, 1),
    model: InputFile | None = None,
    seed: Seed = 0,
    progress: Progress = None,
) -> HandEye:
    """Return what it was given."""
    return (window_frames, limits_mm, model, seed, progress)  # type: ignore[return-value]


STAGE = Stage("test.example", example)
POSE = HandEye(np.eye(4))


def test_signature_tells_sources_and_roles() -> None:
    assert [(s.name, s.type, s.several, s.required) for s in STAGE.sources] == [
        ("pose", HandEye, False, True),
        ("others", HandEye, True, False),
        ("cloud", Cloud, False, False),
    ]
    assert STAGE.parameters["model"] is Role.INPUT_FILE
    assert STAGE.parameters["progress"] is Role.PROGRESS
    assert STAGE.produces == (HandEye,)


def test_a_result_may_be_absent() -> None:
    def one() -> HandEye | None: ...
    def two() -> tuple[Cloud, HandEye | None]: ...
    def none() -> None: ...

    assert [Stage("test.example", made).produces for made in (one, two, none)] == [(HandEye,), (Cloud, HandEye), ()]


def test_call_takes_what_a_notebook_passes() -> None:
    watch = lambda done: None  # noqa: E731
    got: Any = STAGE(
        POSE, window_frames=np.int64(7), limits_mm=np.array([-2.0, 0.5]), model=Path("a.stl"), progress=watch
    )
    assert got == (7, (-2.0, 0.5), Path("a.stl"), 0, watch)
    assert STAGE(pose=POSE, cloud=None)[0] == 5  # artefacts by name too


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"window_frames": 2}, "test.example.window_frames: expected greater than or equal to 3, got 2"),
        ({"window_frames": "7"}, "test.example.window_frames: expected a valid integer, got '7'"),
        ({"window_frames": True}, "expected a valid integer, got True"),
        ({"window_frame": 7}, "no such parameter; did you mean 'window_frames'?"),
        ({"limits_mm": [0, "x"]}, "test.example.limits_mm[1]: expected a valid number"),
        ({"limits_mm": [1]}, "test.example.limits_mm[1]: is required"),
        ({"limits_mm": [0, float("nan")]}, "test.example.limits_mm[1]: expected a finite number"),
        ({"limits_mm": [0, 10**400]}, "limits_mm[1]"),
        ({"model": 3}, "test.example.model"),
        ({"model": "\ud800"}, "test.example"),
        ({"limits_mm": {1, 2}}, "is not a JSON value"),
    ],
)
def test_bad_parameter_is_one_clear_line(given: dict[str, Any], message: str) -> None:
    with pytest.raises(PipelineError) as caught:
        STAGE(POSE, **given)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_wrong_artefact_is_named() -> None:
    made = r"\(made by .*calibrate\.hand_eye"
    with pytest.raises(PipelineError, match=rf"test\.example\.pose: expected one HandEye {made}.*\), got int"):
        STAGE(3)
    with pytest.raises(PipelineError, match=rf"others: expected a list of HandEye {made}.*'x': read it first"):
        STAGE(POSE, ("x",))
    with pytest.raises(PipelineError, match=r"others: expected a list of HandEye .*put it in a list"):
        STAGE(POSE, POSE)
    with pytest.raises(PipelineError, match=r"pose: .*got a tuple of 2 values \(int, HandEye\): give its part \[1\]"):
        STAGE((1, POSE))


def test_missing_artefact_is_named() -> None:
    with pytest.raises(PipelineError, match=r"test\.example\.pose: missing: expected one HandEye \(made by "):
        STAGE()
    with pytest.raises(PipelineError, match=r"test\.example\.pose: given twice"):
        STAGE(POSE, pose=POSE)


def test_default_outside_its_own_range_is_found() -> None:
    def wrong(*, gain_mm: Annotated[float, Field(gt=0)] = 0.0) -> HandEye: ...

    with pytest.raises(PipelineError, match="gain_mm"):
        Stage("test.wrong", wrong).validate({})


def test_signatures_that_no_pipeline_can_fill_are_refused() -> None:
    def variadic(*poses: HandEye) -> HandEye: ...
    def reserved(pose: HandEye, *, id: int = 3) -> HandEye: ...
    def untyped(pose, *, gain_mm: float = 1) -> HandEye: ...  # type: ignore[no-untyped-def]

    for function in (variadic, reserved, untyped):
        with pytest.raises(PipelineError, match=r"stage test\.x"):
            _ = Stage("test.x", function).sources


def test_names_are_checked_and_kept_apart() -> None:
    with pytest.raises(PipelineError, match=r"family\.verb"):
        stage("Denoise")
    stage("test.once")(example)
    try:
        assert stage("test.once")(example) is not None  # a module loaded twice is the same stage
        with pytest.raises(PipelineError, match="registered by"):
            stage("test.once")(lambda: None)
    finally:
        del REGISTRY["test.once"]


def test_a_value_that_is_none_is_told_with_what_it_would_be_and_without_the_rest() -> None:
    from workbench.inspect import sections
    from workbench.scan import read

    with pytest.raises(PipelineError, match=r"lower and the upper deviation, as \[-0\.5, 0\.5\], got 0\.5"):
        sections(root_tolerance_mm=0.5)
    with pytest.raises(PipelineError, match=r"\(ISO 8601\), got 'yesterday'$"):
        read(recording="none.h5", part={"recorded_at": "yesterday"})
