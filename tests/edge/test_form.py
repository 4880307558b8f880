"""What straight lines leave of the faces: bows and patterns, wherever they stay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bench.coverage.conditions import random_swept_recipe
from workbench.artefacts import FORM, ROUNDING
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.edge.form import (
    ANYWHERE,
    INCIDENCES,
    PLACES,
    SOMEWHERE,
    UNSEEN_INCIDENCE,
    Misfit,
    _alike,
    _bow,
    _broken_edge,
    _excess,
    _groups,
    _known_depths,
    _log_likelihoods,
    _nothing_known,
    _odd_columns,
    levels_mm,
    scattered,
)
from workbench.scan import fuse
from workbench.synthetic import random_recipe, simulate_recording
from workbench.synthetic.swept import simulate_swept
from workbench.units import DEG, Float

FRAMES, COLUMNS, SIGMA = 100, 45, 0.012


def residuals(pattern: Float, first: Float, rng: np.random.Generator) -> tuple[Float, Float, Float]:
    """What lines leave (f, M) of faces of COLUMNS columns from `first` (f,) on; place on the face, and column group."""
    off = np.full((FRAMES, pattern.size), np.nan)
    place = np.zeros(off.shape)
    v = np.arange(COLUMNS) - (COLUMNS - 1) / 2
    for i, start in enumerate(first.astype(int)):
        r = pattern[start : start + COLUMNS] + rng.normal(0.0, SIGMA, COLUMNS)
        off[i, start : start + COLUMNS] = r - r.mean() - v * (v @ r) / (v @ v)
        place[i, start : start + COLUMNS] = np.arange(COLUMNS) * PLACES // COLUMNS
    return off, place, np.broadcast_to(np.arange(pattern.size) * PLACES // COLUMNS, off.shape)


@pytest.mark.parametrize("moved", [0.0, 40.0])
def test_a_pattern_of_the_columns_shows_where_the_face_moves_across_them(moved: float) -> None:
    """Pooled by place on the face a pattern averages out; by column it does not."""
    rng = np.random.default_rng(5)
    smooth = np.convolve(rng.normal(0.0, 1.0, 140), np.ones(8), mode="valid")[:120]
    pattern = 0.012 * smooth / smooth.std()
    off, place, column = residuals(pattern, 10.0 + np.linspace(0.0, moved, FRAMES), rng)
    by_place, by_column = _excess(off, place), _excess(off, column)
    assert 0.3 * 0.012 < math.sqrt(by_column) < 2.0 * 0.012
    if moved:
        assert by_place < 0.5 * by_column


def test_noise_alone_is_no_form() -> None:
    rng = np.random.default_rng(6)
    found = []
    for _ in range(20):
        off, place, column = residuals(np.zeros(120), 10.0 + np.linspace(0.0, 40.0, FRAMES), rng)
        found.append(max(_excess(off, place), _excess(off, column)))
    assert np.sqrt(np.median(found)) < 0.1 * SIGMA


@pytest.mark.parametrize("every", [1, 12, 60])
def test_a_pattern_shows_however_far_apart_the_frames_stand(every: int) -> None:
    """Of 20 frames in 40 mm, or of as many as there are; and few frames do not tell that the edge is sharp."""
    recording, _ = simulate_recording(random_recipe("straight", 3))
    columns = np.arange(recording.z_mm.shape[1])
    off = 0.02 * np.sin(columns / 4.0) + 0.02 * np.sin(columns / 9.0)
    thin = {name: getattr(recording, name)[::every] for name in ("time_s", "x_mm", "pass_index")}
    z = (recording.z_mm + off)[::every].astype(np.float32)
    edge = segment(denoise(fuse(replace(recording, **thin, z_mm=z, intensity=None))))
    assert np.degrees(np.median(edge.bevel.u_by_source[FORM])) > 0.1
    assert len(z) >= 20 or np.median(edge.root.u_by_source[ROUNDING]) > 0.05


def depths(radius: float, inclination: float, incidence: float, bow: float, rng: np.random.Generator) -> Float:
    """Depths (f, 30) under the line of returns of a face with a rounded end, the last one first: rays met one by one.

    Places are lateral to the rays, heights along them; columns 0.05 mm apart at any phase.
    """
    tangent = np.array([math.cos(inclination), math.sin(inclination)])
    normal = np.array([-tangent[1], tangent[0]])  # into the material, away from the sensor
    centre = -radius * tangent + radius * normal  # the virtual edge lies at 0
    turn = incidence - inclination
    end = float((centre + radius * (math.sin(turn) * tangent - math.cos(turn) * normal))[0])
    out = np.empty((400, 30))
    for i in range(len(out)):
        place = end - 0.05 * (np.arange(30) + rng.random())
        leaves = float((-radius * tangent)[0])
        root = np.sqrt(np.maximum(radius**2 - (place - centre[0]) ** 2, 0.0))
        height = np.where(place < leaves, place * math.tan(inclination), centre[1] - root)
        depth = (height - place * math.tan(inclination)) * math.cos(inclination)
        share = (place - place[-1]) / (place[0] - place[-1])
        out[i] = depth + bow * 4.0 * share * (share - 1.0) + rng.normal(0.0, 0.01, 30)
    return out


@pytest.mark.parametrize("inclination_deg", [25.0, 45.0])
def test_a_rounding_is_told_by_its_depths(inclination_deg: float) -> None:
    rng = np.random.default_rng(8)
    edges = np.arange(31.0) * 0.05 / math.cos(math.radians(inclination_deg))
    inclination = math.radians(inclination_deg)
    for radius in (0.2, 0.4):
        found = depths(radius, inclination, math.radians(84.0), 0.0, rng)
        told = _broken_edge(_known_depths(found, edges), edges, inclination, INCIDENCES, ANYWHERE)
        turn = math.radians(84.0) - inclination
        true = radius * (1.0 - math.sin(turn) + (1.0 - math.cos(turn)) * math.tan(inclination))
        assert told.is_proven
        assert _odd_columns(_known_depths(found, edges), told.fall_mm) == 0
        assert 0.5 * radius < told.size_mm < 2.0 * radius
        assert abs(told.beyond_mm - true) < 3.0 * told.beyond_u_mm


@pytest.mark.parametrize("inclination_deg", [25.0, 45.0, 62.0])
def test_two_u_hold_what_roundings_hide_that_the_view_does_not_show(inclination_deg: float) -> None:
    """Of radii drawn evenly up to 0.5 mm; a sharp edge hides nothing."""
    rng = np.random.default_rng(5)
    inclination, seen = math.radians(inclination_deg), INCIDENCES[INCIDENCES > UNSEEN_INCIDENCE]
    edges = np.arange(31.0) * 0.05 / math.cos(inclination)
    held = []
    for radius in rng.uniform(0.0, 0.5, 40):
        incidence = rng.uniform(seen[0], seen[-1])
        known = _known_depths(depths(radius, inclination, incidence, 0.0, rng), edges)
        if not _broken_edge(known, edges, inclination, INCIDENCES, ANYWHERE).is_proven:
            turn = incidence - inclination
            true = radius * (1.0 - math.sin(turn) + (1.0 - math.cos(turn)) * math.tan(inclination))
            held.append(true <= _broken_edge(known, edges, inclination, seen, ANYWHERE, 0.5).hides_mm)
    assert np.mean(held) >= 0.85


@pytest.mark.parametrize("bow_mm", [-0.04, 0.04])
def test_a_bow_is_no_rounding(bow_mm: float) -> None:
    """The last returns of a bowed face lie under its line too."""
    edges = np.arange(31.0) * 0.05 / math.cos(1.0)
    found = depths(1e-9, 1.0, math.radians(84.0), bow_mm, np.random.default_rng(9))
    assert not _broken_edge(_known_depths(found, edges), edges, 1.0, INCIDENCES, ANYWHERE).is_proven


@pytest.mark.parametrize("bow_mm", [0.03, -0.06])
def test_a_bow_shows_at_the_ends(bow_mm: float) -> None:
    """The line of least squares leaves a parabola's ends by two thirds of its height."""
    off, place, _ = residuals(np.zeros(COLUMNS), np.zeros(FRAMES), np.random.default_rng(3))
    t = np.linspace(-1.0, 1.0, COLUMNS)
    assert abs(_bow(off + bow_mm * (1.0 / 3.0 - t**2), place) - abs(bow_mm) * 2.0 / 3.0) < 0.1 * abs(bow_mm)
    assert _bow(off, place) < 0.1 * SIGMA


def test_points_that_scatter_beyond_any_noise_are_in_u() -> None:
    known = Misfit(np.zeros(2), np.zeros(2), 1.0)
    assert (scattered(known, 0.0).turn_u == 0.0).all()
    np.testing.assert_allclose(scattered(known, 0.05).turn_u, 2.1 * 0.05)


def test_a_rounding_between_two_columns_of_a_part_that_lies_still_is_in_u() -> None:
    """All frames see it at one place within the column: what the depths of the others say does not hold for it."""
    inclination, radius, step = math.radians(30.0), 0.08, 0.05
    edges = np.arange(31.0) * step / math.cos(inclination)
    flat = np.random.default_rng(4).normal(0.0, 0.01, (400, 30))
    u = {}
    for name, phases in (("moving", ANYWHERE), ("still", SOMEWHERE)):
        told = _broken_edge(_known_depths(flat, edges), edges, inclination, INCIDENCES, phases)
        assert not told.is_proven
        u[name] = 0.5 * told.hides_mm
    assert u["still"] > 1.2 * u["moving"]
    assert u["still"] < radius


@pytest.mark.parametrize(("columns", "by_mm"), [(1, -0.02), (2, -0.06), (3, 0.1)])
def test_last_columns_that_no_rounding_explains_may_be_no_part_of_the_face(columns: int, by_mm: float) -> None:
    """A filter holds the last values: above the line, where no rounding lies, or as a step under it."""
    edges = np.arange(31.0) * 0.05 / math.cos(1.0)
    held = np.random.default_rng(6).normal(0.0, 0.01, (400, 30))
    held[:, :columns] += by_mm
    known = _known_depths(held, edges)
    fall = _broken_edge(known, edges, 1.0, INCIDENCES, ANYWHERE).fall_mm
    assert columns <= _odd_columns(known, fall) <= columns + 3  # beside it a widest rounding would lie deep


@pytest.mark.parametrize(("columns", "count"), [(7.4, 7), (10.0, 10), (34.0, 20)])
def test_columns_that_are_pooled_lie_on_the_face(columns: float, count: int) -> None:
    limits = _groups(columns)
    assert limits[-1] <= columns + 1e-9
    assert len(limits) - 1 == count
    assert (np.diff(limits) >= 1.0).all()


def test_a_face_of_few_columns_may_be_rounded() -> None:
    edges = np.arange(7.0) * 0.1
    assert _broken_edge(_nothing_known(6), edges, 0.5, INCIDENCES, ANYWHERE).hides_mm > 0.06


@pytest.mark.parametrize("together", [1, 8, 32])
def test_frames_that_share_their_errors_count_as_one(together: int) -> None:
    depths = np.repeat(np.random.default_rng(8).normal(0.0, 0.01, (480 // together, 12)), together, axis=0)
    assert _alike(depths) == pytest.approx(together, rel=0.3)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_two_levels_are_told_by_the_differences_of_neighbours(share: float) -> None:
    rng = np.random.default_rng(11)
    off = rng.normal(0.0, 0.01, (120, 150)) + 0.05 * np.sin(np.linspace(0.0, 4.0, 150))  # a form is no level
    off[rng.random(off.shape) < 0.02] += 0.4  # strays
    off[rng.random(off.shape) < 0.05] = np.nan
    assert levels_mm(off) == 0.0
    assert levels_mm(rng.standard_t(4, off.shape)) == 0.0
    apart = 0.06
    assert levels_mm(off + apart * (rng.random(off.shape) < share)) == pytest.approx(apart, rel=0.3)


def test_a_proven_rounding_makes_no_doubt_of_the_root_faces_direction() -> None:
    """Its rim lies 0.01 mm deep and is no part of the line: it made u 0.8 deg where the angle was 0.1 deg off."""
    recording, truth = simulate_swept(random_swept_recipe("swept_rounded", 5102))
    bevel = 5.0 * round(float(truth.bevel_deg.mean()) / 5.0)
    edge = segment(fuse(recording), root_nominal_mm=1.5, bevel_nominal_deg=bevel)
    off = edge.bevel.value[edge.seen] / DEG - truth.bevel_deg_at(edge.position_mm[edge.seen])
    u = edge.bevel.u[edge.seen] / DEG
    assert any("rounded" in one for one in edge.warnings)
    assert np.nanmedian(u) < 0.2
    assert np.nanmax(np.abs(off) / u) < 3.0


def test_shapes_that_reach_differently_far_have_their_own_likelihoods() -> None:
    """As scipy's normal density, whatever the shape before left of the Cholesky rows."""
    rng = np.random.default_rng(8)
    groups, shapes = 12, 40
    wide = rng.normal(size=(groups, groups))
    covariance, mean = wide @ wide.T + np.eye(groups), rng.normal(size=groups)
    fall, u, found = np.zeros((shapes, groups)), np.zeros((shapes, groups)), np.empty(shapes)
    for n, reach in enumerate(rng.integers(0, groups + 1, shapes)):
        fall[n, :reach], u[n, :reach] = rng.normal(size=(2, reach)) ** 2
    _log_likelihoods(mean, covariance, fall, u, found)
    plain = [stats.multivariate_normal(fall[n], covariance + np.diag(u[n] ** 2)).logpdf(mean) for n in range(shapes)]
    np.testing.assert_allclose(found - 0.5 * groups * math.log(2.0 * math.pi), plain, rtol=0, atol=1e-9)
