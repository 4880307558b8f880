"""Root face and bevel face found in every frame of simulated scans, against the faces that the rays really met."""

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
from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Cloud
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.edge.faces import find_faces, rises_with_column
from workbench.errors import InputError
from workbench.geometry.poses import pose_from
from workbench.scan import fuse
from workbench.synthetic import raycast, simulate_recording
from workbench.synthetic.scan import plan_motion, scan_pass
from workbench.units import AnyArray, Int

TRUE = {raycast.ROOT: ROOT_FACE, raycast.BEVEL: BEVEL_FACE, raycast.UPPER: UPPER_SURFACE, raycast.LOWER: LOWER_SURFACE}
Scans = Callable[..., Any]


def true_labels(scan: Any) -> AnyArray:
    """The face that each ray met, as labels of an edge (0: none of its faces)."""
    motions = plan_motion(scan.recipe)
    rays = [block.faces for k, motion in enumerate(motions) for _, block in scan_pass(scan.recipe, motion, k)]
    met = np.concatenate(rays)
    return np.select([met == ray for ray in TRUE], list(TRUE.values()), 0)


@pytest.mark.parametrize("elevation_deg", [50.0, 0.0, -25.0])
@pytest.mark.parametrize(("x_rises", "z_away"), [(True, True), (False, False)])
def test_points_bear_the_name_of_their_face(scanned: Scans, elevation_deg: float, x_rises: bool, z_away: bool) -> None:
    scan = scanned(
        passes=[{"from_mm": 5.0, "to_mm": 25.0, "elevation_deg": elevation_deg}],
        scanner={"columns": 500, "x_rises": x_rises, "z_away": z_away},
    )
    made, truth = scan.tracked, true_labels(scan)
    assert made.seen.all()
    for face in (ROOT_FACE, BEVEL_FACE):
        named = made.labels == face
        assert (truth[named] == face).mean() > 0.98  # the points next to a corner may be either's
        assert named[truth == face].mean() > 0.95
        lines = made.faces[face]
        inside = (truth == face)[np.arange(len(truth)), (lines.columns.sum(axis=1) // 2)]
        assert inside.all()
    for face in (UPPER_SURFACE, LOWER_SURFACE):
        named = made.labels == face
        assert not named.any() or (truth[named] == face).mean() > 0.99
    assert (made.labels == UPPER_SURFACE).any() == (elevation_deg > 10)
    assert made.end_is_corner.all() == (elevation_deg < -10)
    assert set(made.side) == {made.side[0]}


def test_lines_are_those_of_the_faces_points(scanned: Scans) -> None:
    scan = scanned()
    made, truth = scan.tracked, true_labels(scan)
    for face in (ROOT_FACE, BEVEL_FACE):
        lines = made.faces[face]
        for i in range(0, len(truth), 25):
            mine = (truth[i] == face) & scan.cloud.keep[i]
            x, z = scan.cloud.x_mm[i, mine].astype(float), scan.cloud.z_mm[i, mine].astype(float)
            slope, offset = np.polyfit(x, z, 1)
            sigma = 0.02 / np.sqrt(((x - x.mean()) ** 2).sum())
            assert lines.sxz[i] / lines.sxx[i] == pytest.approx(slope, abs=4 * sigma)
            assert lines.z_mean[i] == pytest.approx(slope * lines.x_mean[i] + offset, abs=0.015)
            assert 0.5 * mine.sum() < lines.count[i] <= mine.sum() + 2


def test_noise_of_the_faces(scanned: Scans) -> None:
    for noise in (0.006, 0.03):
        made = scanned(scanner={"columns": 500, "noise": {"sd_mm": noise, "grazing_power": 0.0}}).tracked
        np.testing.assert_allclose(made.range_sigma_mm[:, :3], noise, rtol=0.15)


def test_frames_under_clamps_do_not_see_the_edge(scanned: Scans) -> None:
    scan = scanned(part={"length_mm": 60.0, "clamps": [{"from_mm": 20.0, "to_mm": 32.0, "height_mm": 15.0}]})
    at = scan.cloud.base_from_profiler[:, 0, 3] - scan.cloud.base_from_profiler[0, 0, 3]
    along = 5.0 + 50.0 * at / at[-1]
    hidden = np.interp(along, scan.truth.arc_length_mm, ~scan.truth.seen)  # the clamp's shadow counted in
    made = scan.tracked
    assert (hidden == 1).sum() > 50
    assert not made.seen[hidden == 1].any()
    assert made.seen[hidden == 0].mean() > 0.97
    for face in made.faces.values():
        assert (face.count[~made.seen] == 0).all()
        assert np.isnan(face.x_mean[~made.seen]).all()
        assert (face.columns[~made.seen] == -1).all()
    assert np.isnan(made.root_end[~made.seen]).all()


@pytest.mark.parametrize("kind", ["raw", "flat"])
def test_what_is_no_milled_edge_is_refused(scanned: Scans, kind: str) -> None:
    if kind == "raw":
        cloud = scanned(part={"length_mm": 60.0, "kind": "raw"}).cloud
    else:
        cloud = scanned(passes=[{"from_mm": 5.0, "to_mm": 55.0, "aim_mm": [-60.0, 8.0]}]).cloud  # upper surface alone
    with pytest.raises(InputError, match=r"no edge in view: expected a root face next to a bevel face of 40 deg"):
        find_faces(cloud, 1.5, 40.0)


def without_columns(cloud: Cloud, first: int, last: int) -> Cloud:
    """What a sensor with columns first to last - 1 alone would have seen."""
    return replace(
        cloud,
        x_mm=np.ascontiguousarray(cloud.x_mm[:, first:last]),
        z_mm=np.ascontiguousarray(cloud.z_mm[:, first:last]),
        keep=np.ascontiguousarray(cloud.keep[:, first:last]),
    )


def test_a_root_face_that_runs_out_of_the_field_is_refused(scanned: Scans) -> None:
    scan = scanned()
    truth = true_labels(scan) == ROOT_FACE
    first, last = truth.argmax(axis=1), truth.shape[1] - truth[:, ::-1].argmax(axis=1)
    outwards = scan.tracked.side[0] * (1 if rises_with_column(scan.cloud.x_mm, scan.cloud.keep, np.arange(5)) else -1)
    middle = int(np.median(0.5 * (first + last)))
    limits = (0, middle) if outwards > 0 else (middle, truth.shape[1])
    with pytest.raises(InputError, match="lower edge not in view: the root face runs out of the field of view"):
        find_faces(without_columns(scan.cloud, *limits), 1.5, 40.0)
    cut = without_columns(scan.cloud, *limits)
    kept = cut.keep & (np.random.default_rng(3).random(cut.keep.shape) > 0.02)
    order = np.argsort(~kept, axis=1, kind="stable")
    x, z, keep = (np.take_along_axis(one, order, axis=1) for one in (cut.x_mm, cut.z_mm, kept))
    with pytest.raises(InputError, match="packed into the first columns"):
        find_faces(replace(cut, x_mm=x, z_mm=np.where(keep, z, np.nan).astype(np.float32), keep=keep), 1.5, 40.0)


def test_empty_frames_and_few_frames(scanned: Scans) -> None:
    cloud = scanned().cloud
    with pytest.raises(InputError, match="no edge in view"):
        find_faces(replace(cloud, keep=np.zeros_like(cloud.keep)), 1.5, 40.0)
    some: Int = np.array([3, 60, 61, 62, 200])
    by_frame = ("x_mm", "z_mm", "keep", "pass_index", "time_s", "base_from_profiler")
    few = replace(cloud, **{name: getattr(cloud, name)[some] for name in by_frame})
    assert find_faces(few, 1.5, 40.0).seen.all()


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
