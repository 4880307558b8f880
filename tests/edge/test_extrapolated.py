"""Corners of a joint that no return shows are called extrapolated, with how far off the nearest return is."""

import re
from dataclasses import replace

import numpy as np
import pytest

from workbench import edge, scan
from workbench.artefacts import Cloud, Joint


@pytest.fixture(scope="module")
def groove() -> tuple[Cloud, Joint]:
    cloud = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
    return cloud, edge.segment_groove(cloud)


def test_corners_that_returns_show_are_not_extrapolated(groove: tuple[Cloud, Joint]) -> None:
    assert not [one for one in groove[1].warnings if "extrapolated" in one]


def test_a_corner_without_returns_is_extrapolated(groove: tuple[Cloud, Joint]) -> None:
    bare_mm = 0.4
    cloud, joint = groove
    corner = joint.corners["left_upper"].section_mm
    line = joint.origin_mm + corner[:, :1] * joint.normal + corner[:, 1:] * joint.across
    row, column = np.nonzero(cloud.keep)
    along = joint.tangent[len(line) // 2]
    place = cloud.placed(row, column)
    nearest = np.interp(place @ along, line @ along, np.arange(len(line))).round().astype(int)
    away = place - line[nearest]
    away -= (away @ along)[:, None] * along
    keep = cloud.keep.copy()
    keep[row, column] = np.linalg.norm(away, axis=1) > bare_mm
    found = edge.segment_groove(replace(cloud, keep=keep))
    told = [one for one in found.warnings if "extrapolated" in one]
    assert len(told) == 1
    assert told[0].startswith("corner left_upper ")
    size = float(re.findall(r"([\d.]+) mm", told[0])[0])
    assert bare_mm - 0.02 < size < bare_mm + 0.12
