"""What a sensor errs by its columns, and what is the form of a face."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from bench.drawn.swept import random_swept_recipe
from bench.score import swept, triangulated
from bench.score.measure import alone
from bench.score.parts import Draw
from bench.score.swept import milled_part
from bench.simulators.swept import simulate_swept
from tests.seldom import seldom
from workbench.artefacts import Cloud
from workbench.edge import segment_groove
from workbench.edge.column_errors import Linearity, column_errors
from workbench.geometry.chains import labelled_lines
from workbench.scan import fuse
from workbench.units import Float

COLUMNS, FRAMES, WIDE = 120, 200, 40  # of the view; of the face
PITCH_MM, NOISE_MM = 0.05, 0.01
FACE = 1


def seen(form_mm: Float, errors_mm: Float, moves: float, seed: int = 3) -> Cloud:
    """A face whose form, (WIDE,) or (FRAMES, WIDE), moves by so many columns over errors (COLUMNS,) of the sensor."""
    rng, form = np.random.default_rng(seed), np.broadcast_to(form_mm, (FRAMES, WIDE))
    z = np.full((FRAMES, COLUMNS), np.nan)
    for i, first in enumerate(np.linspace(20.0, 20.0 + moves, FRAMES).round().astype(int)):
        on = slice(first, first + WIDE)
        z[i, on] = 100.0 + 0.3 * np.arange(WIDE) * PITCH_MM + form[i] + errors_mm[on] + NOISE_MM * rng.normal(size=WIDE)
    x = np.tile(PITCH_MM * np.arange(COLUMNS), (FRAMES, 1))
    known = np.isfinite(z)
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    return Cloud(x.astype(np.float32), z.astype(np.float32), known, poses, np.arange(FRAMES), np.zeros(FRAMES, int))


def turned_mm(cloud: Cloud, errors_mm: Float) -> tuple[float, float]:
    """By how much the errors' slope over the face, in the middle of the scan, is off; its standard uncertainty."""
    labels = np.where(cloud.keep, FACE, 0).astype(np.uint8)
    lines = labelled_lines(cloud.x_mm, cloud.z_mm, labels, FACE)
    found = column_errors(cloud, labels, {FACE: lines}, Linearity(0.0))[FACE]
    on = np.flatnonzero(cloud.keep[FRAMES // 2])
    weight = PITCH_MM * (on - on.mean()) / (PITCH_MM**2 * ((on - on.mean()) ** 2).sum())
    of_nodes = np.bincount(found.node[on], weight, len(found.covariance))
    return float(weight @ (found.mean_mm - errors_mm)[on]), float(np.sqrt(of_nodes @ found.covariance @ of_nodes))


def pattern(seed: int) -> Float:
    """Errors of 0.01 mm, alike over some columns."""
    rng, out = np.random.default_rng(seed), np.zeros(COLUMNS)
    for k in range(1, COLUMNS):
        out[k] = 0.8 * out[k - 1] + 0.006 * rng.normal()
    return out


STEP, BOW = 0.06 * (np.arange(WIDE) > 17), 0.1 * np.linspace(-1.0, 1.0, WIDE) ** 2


@pytest.mark.parametrize("form", [0.0 * BOW, BOW, STEP], ids=["straight", "bowed", "stepped"])
def test_the_errors_of_a_face_that_moves_are_found_within_their_uncertainty(form: Float) -> None:
    z, before = [], []
    for seed in range(8):
        errors = pattern(seed)
        off, u = turned_mm(seen(form, errors, 40.0), errors)
        z.append(off / u)
        before.append(off / turned_mm(seen(form, errors, 0.0), errors)[0])
    assert np.sqrt(np.mean(np.square(z))) < 2.0
    assert np.median(np.abs(before)) < 0.6


@pytest.mark.parametrize("moves", [0.0, 6.0, 40.0])
@pytest.mark.parametrize("form", [0.0 * BOW, BOW, STEP], ids=["straight", "bowed", "stepped"])
def test_the_form_of_a_face_is_no_error_of_the_sensor(form: Float, moves: float) -> None:
    off, u = turned_mm(seen(form, np.zeros(COLUMNS), moves), np.zeros(COLUMNS))
    assert abs(off) < 1e-4
    assert u < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_roughness_that_changes_along_the_edge_is_no_error_of_the_sensor(seed: int) -> None:
    """A raw face of 0.25 mm rms: 'errors' of 0.03 mm, in all frames, took 0.8 deg off its normal."""
    rough = gaussian_filter(np.random.default_rng(seed).normal(size=(FRAMES, WIDE)), (6.0, 6.0))
    off, u = turned_mm(seen(0.1 * rough / rough.std(), np.zeros(COLUMNS), 40.0), np.zeros(COLUMNS))
    assert abs(off) < 1e-4
    assert u < 1e-3


def test_a_face_that_stays_in_its_columns_shows_no_error_of_the_sensor() -> None:
    errors = pattern(1)
    cloud = seen(0.0 * BOW, errors, 0.0)
    labels = np.where(cloud.keep, FACE, 0).astype(np.uint8)
    found = column_errors(cloud, labels, {FACE: labelled_lines(cloud.x_mm, cloud.z_mm, labels, FACE)}, Linearity(0.0))
    assert not found[FACE].mean_mm.any()


@pytest.mark.parametrize("drawn", [swept.groove, *seldom(triangulated.groove)])
def test_a_pattern_turns_no_face_of_a_groove(drawn: Draw) -> None:
    """Faces of more columns than nodes were turned by 3.7 deg, 5 u, for what lay within the nodes."""
    cloud = fuse(drawn(3).recording)
    off = 0.02 * np.random.default_rng(1).normal(size=cloud.z_mm.shape[1])
    usual, found = (segment_groove(replace(cloud, z_mm=(cloud.z_mm + o).astype(np.float32))) for o in (0.0 * off, off))
    for name, one in found.sizes.items():
        assert np.nanmax(np.abs(one.value - usual.sizes[name].value) / one.u) < 3.0, name
    told = [any("errs by its columns" in words for words in one.warnings) for one in (usual, found)]
    assert told == [False, True]


@pytest.mark.parametrize("seed", [15_000_030, *seldom(15_000_004)])
def test_a_bevel_is_rid_of_a_pattern_that_all_frames_have(seed: int) -> None:
    """Bevels that were 0.8 and 1.7 deg off, with u of as much."""
    found = alone(milled_part(*simulate_swept(random_swept_recipe("swept_fixed_pattern", seed)))).found["bevel_deg"]
    assert np.abs(found.error / found.u).max() < 2.5
    assert np.median(found.u) < 0.7
