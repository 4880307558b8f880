"""The residual image: what lasts of a sensor's error is in u, what is noise is not."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bench.drawn.swept import random_swept_recipe
from bench.outside import Part, Usual, drawn_section, simulate
from bench.score.measure import alone
from bench.score.outsider import Sharp
from bench.score.swept import milled_part, worn
from bench.simulators.swept import simulate_swept
from tests.edge.test_broken_end import measured
from tests.laws.dozen import plate
from tests.seldom import seldom
from workbench.artefacts import FORM
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.edge.column_errors import ColumnErrors, Linearity
from workbench.edge.residual_image import FaceImage, SeenBy, forms
from workbench.errors import WorkbenchError
from workbench.result_files import SensorFile
from workbench.scan import fuse
from workbench.units import DEG, Float

WALKING = (45, 51, 58)  # the first of seed 40 and on whose sensor walks
QUIET = 40  # whose noise is 0.005 mm or less


class Walking(Usual):
    """A sensor whose own error walks over its columns, by so many times the usual walk."""

    def __init__(self, flawed: float) -> None:
        self.flawed = flawed


@cache
def walking(seed: int, flawed: float) -> Part:
    return simulate(seed, False, replace(drawn_section(seed, False, Usual())[1], radius_mm=0.0), Walking(flawed))


def test_the_angle_of_a_sensor_that_walks_lies_within_its_uncertainty() -> None:
    z = []
    for seed in WALKING:
        part = walking(seed, 2.0)
        edge = measured(part, edge_condition="sharp")
        z.append(np.median((edge.bevel.value - part.section.bevel / DEG)[edge.seen] / edge.bevel.u[edge.seen]))
    assert np.sum(np.abs(z) < 2.0) >= 2
    assert np.abs(z).max() < 4.0


def test_the_errors_of_wide_faces_columns_count_too() -> None:
    """A bevel face of 250 columns under a narrow root face: alone, the root face disproves nothing."""
    part = simulate(17700003, False, cell=Sharp())
    edge = measured(part, edge_condition="sharp")
    assert np.nanmax(np.abs(edge.bevel.value - part.section.bevel / DEG) / edge.bevel.u) < 3.5


def test_a_sensor_without_an_error_leaves_little_in_u() -> None:
    form = measured(walking(QUIET, 0.0), edge_condition="sharp").bevel.u_by_source[FORM]
    assert np.nanmedian(form) < 0.05


def test_u_follows_the_linearity_that_is_declared(tmp_path: Path) -> None:
    part, found = walking(41, 0.0), []
    for number, rms in enumerate((0.001, 0.004, 0.016)):
        file = tmp_path / f"sensor{number}.json"
        file.write_text(json.dumps({"filters": None, "body": None, "linearity_mm": rms, "linearity_length_mm": 4.0}))
        found.append(float(np.nanmedian(measured(part, sensor=file).bevel.u_by_source[FORM])))
    assert found[1] / found[0] == pytest.approx(4.0, rel=0.2)
    assert found[2] / found[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"triangulation_deg": 0.436}, r"\.triangulation_deg: expected .* 2"),
        ({"linearity_mm": -1}, r"\.linearity_mm: expected"),
        ({"linearity_um": 4}, r": unknown key 'linearity_um'; did you mean 'linearity_mm'"),
        ({"flange_from_profiler": 4}, ": says nothing of a sensor"),
    ],
)
def test_a_sensor_file_with_another_unit_is_refused(tmp_path: Path, content: dict[str, float], message: str) -> None:
    file = tmp_path / "sensor.json"
    file.write_text(json.dumps(content))
    cloud = denoise(fuse(plate().recording))
    with pytest.raises(WorkbenchError, match=rf"sensor\.json: \${message}"):
        segment(cloud, sensor=file)


def test_a_sensor_file_may_say_more(tmp_path: Path) -> None:
    file = tmp_path / "sensor.json"
    file.write_text(json.dumps({"columns": 640, "maker": "A", "noise_mm": 0.01, "noise_x_mm": 0.02, "version": 1}))
    assert SensorFile.read(file).noise_mm == 0.01


PLACE_MM = np.linspace(-0.75, 0.75, 16)


def seen_by(middle_mm: float = 0.0, lean: float = 1.0) -> SeenBy:
    """A pass that sees the face's middle there, ten columns a mm."""
    ends, middle, place = np.array([-1.0, 1.0]), np.full(2, middle_mm), PLACE_MM / lean
    return SeenBy(ends, middle, 10.0 * middle + 20.0, place, 10.0 * place, lean)


def image_of(mean: Float, *passes: SeenBy) -> FaceImage:
    """A face without lean, of whose places each stretch (k, 16) leaves so much beside 1 um of noise."""
    count = len(mean)
    noise = np.broadcast_to(1e-6 * np.eye(16), (count, 16, 16))
    of_pass = np.arange(count) if passes else np.zeros(count, int)
    return FaceImage(np.zeros((count, 2)), mean, noise, PLACE_MM, np.zeros(count), of_pass, passes or (seen_by(),))


@pytest.mark.parametrize(("begin", "end", "end_mm"), [(9, 16, 0.03), (5, 9, 0.0), (0, 4, 0.03)])
def test_the_line_goes_without_a_part_that_stands_aside(begin: int, end: int, end_mm: float) -> None:
    """A step, a second return in the middle; an end of the face is that of the part there, or not: half of it in u."""
    place_mm = PLACE_MM
    part = np.where((np.arange(16) >= begin) & (np.arange(16) < end), 0.06, 0.0)
    line = np.polynomial.Polynomial.fit(place_mm, part, 1).convert()
    noise = np.random.default_rng(5).normal(0.0, 1e-3, 16)
    form = forms([image_of((part + noise - line(place_mm))[None])], np.zeros(1), Linearity())[0]
    assert form.turn[0] == pytest.approx(line.coef[1], abs=1e-3)
    assert form.turn_u[0] < 0.5 * DEG
    side = form.lower_u_mm if end == 16 else form.upper_u_mm
    assert side[0] == pytest.approx(end_mm, abs=0.01)


@pytest.mark.parametrize("slope", [-1.5, 0.0, 0.7, 2.0])
def test_a_step_turns_the_face_by_an_angle_not_by_a_slope(slope: float) -> None:
    """As a line of least squares through both of its parts lies, the step looks smaller or larger across it."""
    x = PLACE_MM / np.hypot(1.0, slope)
    z = slope * x + np.where(np.arange(16) >= 9, 0.15 * np.hypot(1.0, slope), 0.0)
    offset, tilted = np.polynomial.Polynomial.fit(x, z, 1).convert().coef
    lean = np.hypot(1.0, tilted)
    noise = np.random.default_rng(5).normal(0.0, 1e-3, 16)
    image = image_of(((z - offset - tilted * x) / lean + noise)[None])
    image = image._replace(place_mm=lean * x, slope=np.array([tilted]))
    form = forms([image], np.zeros(1), Linearity())[0]
    assert form.turn[0] == pytest.approx(np.arctan(tilted) - np.arctan(slope), abs=2e-3)


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("ghosts", 15_000_039),
        ("worn", 15_100_005),
        *seldom(("ghosts", 15_000_052), ("ghosts", 17_100_016), ("ghosts", 15_200_030)),
    ],
    ids=str,
)
def test_what_stands_aside_over_a_part_of_the_edge_moves_no_angle(kind: str, seed: int) -> None:
    """Second returns from 18 to 73 mm turned a bevel by 0.98 deg (6.4 u); burrs are taken out once, not twice."""
    drawn = milled_part(*simulate_swept(random_swept_recipe("swept_ghosts", seed))) if kind == "ghosts" else worn(seed)
    found = alone(drawn).found["bevel_deg"]
    assert np.abs(found.error / found.u).max() < 2.5
    assert np.median(found.u) < 0.15


def test_noise_alone_turns_no_line() -> None:
    rng = np.random.default_rng(6)
    for _ in range(20):
        form = forms([image_of(rng.normal(0.0, 1e-3, (1, 16)))], np.zeros(1), Linearity())[0]
        assert abs(form.turn[0]) < 0.1 * form.turn_u[0]


def test_a_face_without_noise_has_the_sensors_linearity() -> None:
    """Returns that all lie on one digit of the sensor, as of a face square to its rays."""
    passes = [seen_by(off) for off in (0.0, 10.0)]
    for image in (image_of(np.zeros((1, 16))), image_of(np.zeros((2, 16)), *passes)):
        seen = (image._replace(noise=share * image.noise) for share in (0.0, 1e-4))
        one, other = (forms([of], np.zeros(1), Linearity())[0] for of in seen)
        for name in ("turn_u", "lower_u_mm", "upper_u_mm"):
            assert getattr(one, name)[0] == pytest.approx(getattr(other, name)[0], rel=0.1), name


@pytest.mark.parametrize(("apart_mm", "share"), [(0.0, 1.0), (10.0, np.sqrt(0.5))])
def test_passes_average_what_the_sensor_errs_by_other_columns(apart_mm: float, share: float) -> None:
    linearity, nothing = Linearity(0.02, 1.0), np.zeros((2, 16))
    one = forms([image_of(nothing[:1])], np.zeros(1), linearity)[0]
    passes = [seen_by(off) for off in (0.0, apart_mm)]
    both = forms([image_of(nothing, *passes)], np.zeros(1), linearity)[0]
    for name in ("turn_u", "lower_u_mm", "upper_u_mm"):
        assert getattr(both, name)[0] == pytest.approx(share * getattr(one, name)[0], rel=0.03), name


@pytest.mark.parametrize(("apart_mm", "share"), [(0.0, 1.0), (10.0, np.sqrt(0.5))])
def test_passes_average_what_is_open_of_other_columns(apart_mm: float, share: float) -> None:
    column = np.arange(200)
    open_mm2 = 1e-4 * np.exp(-np.abs(column[:, None] - column) / 3.0)
    errors = ColumnErrors(np.zeros(200), column, open_mm2)
    images = image_of(np.zeros((1, 16))), image_of(np.zeros((2, 16)), seen_by(), seen_by(apart_mm))
    told = [forms([one._replace(errors=errors)], np.zeros(1), Linearity(0.0))[0].turn_u[0] for one in images]
    assert told[1] == pytest.approx(share * told[0], rel=0.03)


def test_what_a_sensor_errs_counts_less_on_a_steep_face() -> None:
    """By the rays: across the face is less, and more of it lies between two columns. A slope counts by both."""
    square, steep = (seen_by(lean=lean) for lean in (1.0, 2.0))
    distortion, flat = Linearity(1.0, 100.0), np.zeros((1, 16))
    one, other = (forms([image_of(flat, of)], np.zeros(1), distortion)[0] for of in (square, steep))
    assert other.turn_u[0] == pytest.approx(one.turn_u[0] / 2.0**2, rel=0.05)


def test_passes_do_not_average_what_lasts_of_a_face() -> None:
    """As uncertain as by one pass; more of the same tells only how strong it is."""
    walked = np.stack([np.random.default_rng(8).normal(0.0, 0.02, 16).cumsum()] * 2)
    one = forms([image_of(walked[:1])], np.zeros(1), Linearity(0.0))[0]
    passes = [seen_by(off) for off in (0.0, 10.0)]
    both = forms([image_of(walked, *passes)], np.zeros(1), Linearity(0.0))[0]
    assert both.turn_u[0] == pytest.approx(one.turn_u[0], rel=0.2)


@pytest.mark.parametrize("sag_mm", [0.02, 0.1])
def test_a_bowed_face_has_the_direction_of_its_line(sag_mm: float) -> None:
    """That of least squares over all of it; what walks across it by as much turns it, and so does a hidden end."""
    bow = sag_mm * (PLACE_MM / PLACE_MM[-1]) ** 2
    walked = np.random.default_rng(8).normal(0.0, sag_mm / 4.0, 16).cumsum()
    bowed, rough = (forms([image_of(one[None])], np.zeros(1), Linearity(0.0))[0] for one in (bow, walked))
    assert bowed.turn_u[0] < 0.25 * rough.turn_u[0]
    shown = np.arange(PLACE_MM.size) < PLACE_MM.size - 2
    turned = np.polyfit(PLACE_MM[shown], bow[shown], 1)[0] - np.polyfit(PLACE_MM, bow, 1)[0]
    hidden_mm = PLACE_MM[-1] - PLACE_MM[shown][-1]
    assert bowed.bowed[0] * hidden_mm == pytest.approx(abs(turned), rel=0.1)
