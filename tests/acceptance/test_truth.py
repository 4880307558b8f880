"""Sizes, places and senses against a truth that the project had no hand in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.seldom import seldom

from .conftest import PART, SCAN, Ended
from .hdf import write
from .judge import errors
from .stranger import Part, Scan, Setting, any_setting, record, with_all

Run = Callable[..., Ended]
BACK = {"start_mm": 124.0, "stop_mm": -4.0}
CASES: dict[str, tuple[Part, list[Scan]]] = {
    "arc from above": (PART, [SCAN]),
    "straight, frontal, other way": (
        Part(root_mm=(1.2, 1.3), bevel_deg=(39, 40)),
        [replace(SCAN, elevation_deg=12, x_sense=-1, falling=True, **BACK)],
    ),
    "hollow, from below, counts towards": (
        replace(PART, curvature_per_mm=-1 / 400),
        [replace(SCAN, elevation_deg=-14, z_sense=-1, poses="dense")],
    ),
    "wavy, upside down, far zero": (
        Part(wave_rad=0.06, tilt_deg=1.5),
        [replace(SCAN, x_sense=-1, z_sense=-1, x_zero_mm=900, z_zero_mm=1500, yaw_deg=-12, poses="frames")],
    ),
    "two passes, both sides": (
        Part(root_mm=(1.7, 1.5)),
        [replace(SCAN, pass_index=7), replace(SCAN, pass_index=-3, elevation_deg=-12, x_sense=-1, **BACK)],
    ),
    "followed, disturbed, on a table": (
        PART,
        [replace(SCAN, follow=True, poses="dense", outliers=0.03, dropouts=0.1, mixed=0.5, table_mm=12)],
    ),
}


QUICK = ("hollow, from below, counts towards", "followed, disturbed, on a table", "two passes, both sides")


@pytest.mark.parametrize("case", [*QUICK, *seldom(*(case for case in CASES if case not in QUICK))])
def test_inspection_is_true(case: str, run: Run, folder: Path) -> None:
    part, scans = CASES[case]
    setting = any_setting(np.random.default_rng(len(case)))
    path = write(folder / "case.h5", record(part, scans, setting, 3), form="lzf")
    ended = run(path)
    inspection = ended.read()
    undecided = [one for one in inspection["sections"] if one["verdict"] != "pass"]
    assert all(_touches_a_limit(one) for one in undecided)
    assert ended.status == (1 if undecided else 0), ended.err
    found = errors(inspection, part, setting)
    assert np.max(found.off_mm) < 0.1
    assert np.max(found.aside_deg) < 0.5  # and so not turned round either
    assert np.max(np.abs(found.root_mm)) < 0.03
    assert np.max(np.abs(found.bevel_deg)) < 0.15
    stretch = inspection["profile"]["arc_length_mm"][-1]
    assert stretch == pytest.approx(part.length_mm, abs=4)
    assert found.told_mm == pytest.approx((np.arange(1, 10) - 0.5) / 9 * stretch, abs=1e-6)
    assert np.ptp(found.told_mm - found.along_mm) < 0.2
    assert abs(np.mean(found.told_mm - found.along_mm)) < 3  # counted from the first point measured


def _touches_a_limit(section: dict[str, Any]) -> bool:
    """Rightly undecided: a limit of the shipped tolerance lies within 2 u of a value, and u is small."""
    root, bevel = section["root_mm"], section["bevel_deg"]
    root_u, bevel_u = section["root_u_mm"], section["bevel_u_deg"]
    near = min(abs(root - 1), abs(root - 2)) < 2 * root_u or min(abs(bevel - 39), abs(bevel - 41)) < 2 * bevel_u
    return section["verdict"] == "undecided" and near and root_u < 0.015 and bevel_u < 0.1


def test_only_the_part_is_measured(run: Run, folder: Path, setting: Setting) -> None:
    """A pass that begins and ends on the part: arc length 0 is where it begins."""
    scan = replace(SCAN, start_mm=100.0, stop_mm=20.0)
    ended = run(write(folder / "inside.h5", record(PART, [scan], setting, 4)))
    found = errors(ended.read(), PART, setting)
    assert np.all(np.diff(found.along_mm) > 0)
    assert found.told_mm + 20 == pytest.approx(found.along_mm, abs=3)


def test_nothing_is_invented_under_a_clamp(run: Run, folder: Path, setting: Setting) -> None:
    scan = replace(SCAN, clamp_mm=(50.0, 72.0))
    ended = run(write(folder / "clamp.h5", record(PART, [scan], setting, 5)))
    inspection = ended.read()
    found = errors(inspection, PART, setting)
    hidden = (found.along_mm > 51) & (found.along_mm < 71)
    clear = (found.along_mm < 46) | (found.along_mm > 76)  # between the two: the frames of a section are hidden in part
    assert hidden.any()
    assert clear.sum() > 5
    for section, under, seen in zip(inspection["sections"], hidden, clear, strict=True):
        missing = section["root_mm"] is None
        assert missing == (section["bevel_deg"] is None)
        assert missing or not under
        assert not (missing and seen)
        assert section["verdict"] == ("undecided" if missing else "pass")
    assert (ended.status, inspection["verdict"]) == (1, "undecided")
    profile = inspection["profile"]
    told = np.array(profile["arc_length_mm"]) + (found.along_mm - found.told_mm)[0]
    middle = (told > 55) & (told < 67)
    assert all(profile["root_mm"][k] is None for k in np.flatnonzero(middle))
    assert np.nanmax(np.abs(found.root_mm)) < 0.03


def _right_or_missing(inspection: dict, part: Part, setting: Setting) -> None:
    """Every value given is true within four standard uncertainties (0.03 mm, 0.15 deg at least)."""
    found = errors(inspection, part, setting)
    for section, root, bevel in zip(inspection["sections"], found.root_mm, found.bevel_deg, strict=True):
        if section["root_mm"] is not None:
            assert abs(root) < max(0.03, 4 * section["root_u_mm"])
            assert abs(bevel) < max(0.15, 4 * section["bevel_u_deg"])


STOP = replace(SCAN, elevation_deg=8, yaw_deg=0, clamp_mm=(45.0, 75.0), box_mm=(2.0, 6.0, -20.0, 0.4))
UNSEEN = {
    "outside the field of view": (Part(), replace(SCAN, columns=240, skew_mm=8)),
    "behind a stop that covers part of the root face": (Part(), STOP),
    "and 1.5 mm of the upper surface that look like a root face": (
        Part(root_mm=(3.0, 3.0), bevel_deg=(50.0, 50.0)),
        Scan(columns=200, elevation_deg=45, skew_mm=0.5),
    ),
}


@pytest.mark.parametrize("what", UNSEEN)
def test_a_lower_edge_that_is_not_seen_is_not_measured(what: str, run: Run, folder: Path, setting: Setting) -> None:
    part, scan = UNSEEN[what]
    ended = run(write(folder / "unseen.h5", record(part, [scan], setting, 8)))
    if ended.status < 2:
        _right_or_missing(ended.read(), part, setting)


@pytest.mark.parametrize("kind", ["rounded to 0.1 mm", "noise of 0.05 mm"])
def test_poses_as_robots_log_them(kind: str, run: Run, folder: Path, setting: Setting) -> None:
    dense = replace(SCAN, poses="dense", pose_noise_mm=0.05 if "noise" in kind else 0.0)
    arrays = record(Part(), [dense], setting, 0)
    if "rounded" in kind:
        arrays["/robot/position"] = np.round(arrays["/robot/position"], 1)
    _right_or_missing(run(write(folder / "logged.h5", arrays)).read(), Part(), setting)


@pytest.mark.parametrize(
    "change",
    [{"x_sense": -1}, {"z_sense": -1}, {"falling": True}, {"start_mm": 80.0, "stop_mm": 30.0}],
    ids=lambda d: min(d),
)
def test_a_sensor_s_habits_do_not_matter(change: dict, run: Run, folder: Path, setting: Setting) -> None:
    """The same pass by a sensor mounted, or counting, the other way round."""
    sizes = []
    scan = replace(SCAN, start_mm=30.0, stop_mm=80.0)
    for scans in ([scan], with_all([scan], **change)):
        ended = run(write(folder / "habit.h5", record(PART, scans, setting, 6)))
        found = errors(ended.read(), PART, setting)
        sizes.append((found.root_mm, found.bevel_deg))
    assert np.max(np.abs(sizes[0][0] - sizes[1][0])) < 0.04  # the columns meet the lower edge elsewhere
    assert np.max(np.abs(sizes[0][1] - sizes[1][1])) < 0.2
