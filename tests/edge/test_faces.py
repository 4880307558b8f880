"""What is taken for root face and bevel face, and what is refused as neither (where each lies: tests/laws)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.confidently_wrong.kinds import KINDS
from bench.drawn.plates import random_recipe
from bench.drawn.seeds import nominal_sizes
from tests.laws.dozen import ABOVE, plate
from workbench.artefacts import BEVEL_FACE, ROOT_FACE
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.edge.faces import find_faces
from workbench.errors import InputError
from workbench.geometry.poses import pose_from
from workbench.scan import fuse
from workbench.synthetic import simulate_recording

Scans = Callable[..., Any]


@pytest.mark.parametrize(
    "part",
    [
        {"part": {"length_mm": 60.0, "kind": "raw"}},
        {"passes": [{"from_mm": 5.0, "to_mm": 55.0, "aim_mm": [-60.0, 8.0]}]},  # of which the upper surface is in view
    ],
)
def test_what_is_no_milled_edge_is_refused(scanned: Scans, part: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="no edge in view: expected a root face next to a bevel face of 40 deg"):
        segment(scanned(**part).cloud)


def test_a_root_face_that_runs_out_of_the_field_is_refused(scanned: Scans) -> None:
    cloud, labels = scanned().cloud, scanned().edge.labels
    root, bevel = (int(np.median(np.nonzero(labels == face)[1])) for face in (ROOT_FACE, BEVEL_FACE))
    field = np.s_[:, :root] if bevel < root else np.s_[:, root:]
    cut = {name: np.ascontiguousarray(getattr(cloud, name)[field]) for name in ("x_mm", "z_mm", "keep")}
    with pytest.raises(InputError, match="lower edge not in view: the root face runs out of the field of view"):
        segment(replace(cloud, **cut))
    kept = cut["keep"] & (np.random.default_rng(3).random(cut["keep"].shape) > 0.02)
    order = np.argsort(~kept, axis=1, kind="stable")
    x, z, keep = (np.take_along_axis(one, order, axis=1) for one in (cut["x_mm"], cut["z_mm"], kept))
    with pytest.raises(InputError, match="packed into the first columns"):
        segment(replace(cloud, x_mm=x, z_mm=np.where(keep, z, np.nan).astype(np.float32), keep=keep))


def test_a_view_that_ends_on_the_root_face_exchanges_no_faces() -> None:
    """Where the view cuts the root face off, the bevel face passed for it; the frames that show it whole disagree."""
    recording, truth = simulate_recording(random_recipe("two_pass", 8_950_003))
    cropped = KINDS["view ends in the part, right"].spoil(recording, np.random.default_rng([8_950_000, 3]))
    with pytest.raises(InputError, match="frames do not agree which face is the root face"):
        segment(denoise(fuse(cropped)), **nominal_sizes(truth.root_mm.mean(), truth.bevel_deg.mean()))


def test_passes_around_a_pipe_end_are_each_read_by_themselves() -> None:
    """Their upper sides truly differ: no common one is sought, whichever pass comes first."""
    above = ABOVE | {"elevation_deg": 35.0}
    cloud = denoise(fuse(plate(above, above, above).recording))
    found = find_faces(cloud, 1.5, 40.0)
    root, frame = found.faces[ROOT_FACE], cloud.base_from_profiler[0]
    along = frame[:3, 0] + root.sxz[0] / root.sxx[0] * frame[:3, 2]
    axis = np.cross(along / np.linalg.norm(along), frame[:3, 1])
    for turns in ((0, 80, 160), (80, 0, 160)):
        poses = cloud.base_from_profiler.copy()
        for number, turn in enumerate(turns):
            by = pose_from(Rotation.from_rotvec(np.radians(turn) * axis).as_matrix(), np.zeros(3))
            poses[cloud.pass_index == number] = by @ poses[cloud.pass_index == number]
        turned = find_faces(replace(cloud, base_from_profiler=poses), 1.5, 40.0)
        assert turned.seen.sum() == found.seen.sum()
        assert turned.readings_apart == pytest.approx(found.readings_apart)
