"""Where a face ends: on a table, a little above it, behind a stop, at a step, where most frames lose it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.odd_plates import Drawn, Sizes, plate
from bench.outside import FAR_MM, Part, Section, simulate
from bench.score.measure import alone
from bench.score.outsider import plain
from tests.seldom import seldom
from workbench.artefacts import BEVEL_FACE, ROOT_FACE
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
from workbench.path import check, layers
from workbench.scan import fuse
from workbench.units import DEG


def on_table(seed: int, gap_mm: float, is_raw: bool = False) -> Part:
    thick = 7.0
    sizes = Sizes(thick - 1e-3, np.pi / 4.0, thick, gap_mm) if is_raw else Sizes(1.5, 40.0 * DEG, thick, gap_mm)
    return simulate(seed, is_raw, sizes.drawn((plate(sizes.root_mm, sizes.above()),)))


@pytest.mark.parametrize(("is_raw", "gap_mm"), [(False, 0.05), *seldom((True, 0.4), (False, 0.4), (True, 0.05))])
def test_a_gap_below_the_plate_is_in_u(is_raw: bool, gap_mm: float) -> None:
    told, seeds = 0, range(2)
    for seed in seeds:
        found = alone(plain(on_table(seed, gap_mm, is_raw), is_raw))
        told += not found.refused
        assert all((np.abs(one.error) <= 3.0 * one.u).all() for one in found.found.values()), seed
    assert told > 0.5 * len(seeds)


def test_what_a_narrow_root_face_stands_over_does_not_turn_it() -> None:
    """Between the face's end and where its line meets the table, returns are the table's: the bevel was 8 deg off."""
    section = Section(0.8, 0.0, 35.0 * DEG, 6.0, 0.3, 0.25)
    found = alone(plain(simulate(7, False, section), is_raw=False)).found["bevel_deg"]
    assert (np.abs(found.error) <= 3.0 * found.u).all()


def test_a_path_names_that_a_stop_looks_alike() -> None:
    part = on_table(1, 0.0, is_raw=True)
    up = tuple(part.base_from_section[:3, 1].tolist())
    cloud = denoise(fuse(part.recording))
    edge = segment_raw(cloud, upper_side=up)
    assert any("a stop which touches it" in one for one in edge.warnings)
    decision = check(layers(edge, cloud, root_mm=1.5), edge, cloud)
    assert any("a stop which touches it" in one for one in decision.unchecked)


@pytest.mark.parametrize(("gap_mm", "thick_mm"), [(0.3, 7.0), *seldom((0.0, 7.0), (0.0, 40.0))])
def test_a_backing_bar_that_ends_in_the_view_is_no_step(gap_mm: float, thick_mm: float) -> None:
    """No land of a nose is as wide; of a thick plate the upper surface, that would be parallel, is out of view."""
    sizes = Sizes(1.5, 40.0 * DEG, thick_mm, None)
    bar = ((8.0, -3.0), (8.0, -gap_mm), (-5.0, -gap_mm))
    found = alone(plain(simulate(2, False, sizes.drawn((plate(sizes.root_mm, sizes.above()), bar))), is_raw=False))
    assert not found.refused
    assert all((np.abs(one.error) <= 3.0 * one.u).all() for one in found.found.values())


def test_that_it_lies_on_a_table_is_said() -> None:
    edge = segment(denoise(fuse(on_table(0, 0.0).recording)), root_nominal_mm=1.5, bevel_nominal_deg=40.0)
    assert any("lies on" in one for one in edge.warnings)
    assert any("a stop that touches the root face" in one.sentence and one.is_doubt for one in edge.unseen)


@pytest.mark.parametrize("seed", [1, *seldom(2)])
def test_a_stop_in_front_of_the_root_face_is_no_table(seed: int) -> None:
    """Its top is level, as a table is; below it the root face goes on."""
    sizes = Sizes(2.5, 40.0 * DEG, 8.0, None)
    stop = ((0.4, -FAR_MM), (0.4, 1.2), (FAR_MM, 1.2))
    section = sizes.drawn((plate(sizes.root_mm, sizes.above()), stop))
    assert isinstance(section, Drawn)
    found = alone(plain(simulate(seed, False, section), is_raw=False)).found["root_mm"]
    assert (np.abs(found.error) <= 3.0 * found.u).all()


def test_an_end_that_three_frames_in_four_lose_is_in_u() -> None:
    """An exposure that alternates: the face does not return where it is not, so the fourth frame is right."""
    part = on_table(2, 12.0)
    cloud = denoise(fuse(part.recording))
    edge = segment(cloud, root_nominal_mm=1.5, bevel_nominal_deg=40.0)
    z = part.recording.z_mm.copy()
    for i in range(len(z)):
        on = np.flatnonzero(edge.labels[i] == ROOT_FACE)
        bevel = np.flatnonzero(edge.labels[i] == BEVEL_FACE)
        if i % 4 and on.size > 8 and bevel.size:
            z[i, on[-6:] if on[0] > bevel[0] else on[:6]] = np.nan
    found = alone(plain(part._replace(recording=replace(part.recording, z_mm=z)), is_raw=False))
    assert not found.refused
    for one in found.found.values():
        assert (np.abs(one.error) <= 3.0 * one.u).all()
