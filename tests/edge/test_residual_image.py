"""The residual image: what lasts of a sensor's error is in u, what is noise is not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.drawn.plates import random_recipe
from bench.metrology.users import inspect_as_a_user
from bench.odd_plates import odd_plate
from bench.outside import Part, Usual, drawn_section, simulate
from tests.edge.test_rim import measured
from workbench.artefacts import FORM
from workbench.edge.residual_image import FaceImage, Linearity, forms
from workbench.errors import WorkbenchError
from workbench.synthetic import simulate_recording
from workbench.units import DEG, Int

WALKING = (45, 51, 58, 60)  # the first of seed 40 and on whose sensor walks
QUIET = (40, 49)  # some whose noise is 0.005 mm or less


class Walking(Usual):
    """A sensor whose own error walks over its columns, by so many times the usual walk."""

    def __init__(self, flawed: float) -> None:
        self.flawed = flawed


def walking(seed: int, flawed: float) -> Part:
    return simulate(seed, False, replace(drawn_section(seed, False, Usual())[1], radius_mm=0.0), Walking(flawed))


def test_the_angle_of_a_sensor_that_walks_lies_within_its_uncertainty() -> None:
    z = []
    for seed in WALKING:
        part = walking(seed, 2.0)
        edge = measured(part, edge_condition="sharp")
        z.append(np.median((edge.bevel.value - part.section.bevel / DEG)[edge.seen] / edge.bevel.u[edge.seen]))
    assert np.mean(np.abs(z) < 2.0) >= 0.75
    assert np.abs(z).max() < 4.0


def test_a_sensor_without_an_error_leaves_little_in_u() -> None:
    for seed in QUIET:
        form = measured(walking(seed, 0.0), edge_condition="sharp").bevel.u_by_source[FORM]
        assert np.nanmedian(form) < 0.05


def test_a_pattern_that_a_narrow_face_takes_for_its_slope_is_told_by_wide_ones() -> None:
    """A wave of 16 columns turns a root face of eight: eight u while wide faces were read by twenty columns at once."""
    recording, truth = simulate_recording(random_recipe("oblique", 8704))
    wave = 0.02 * np.sin(2.0 * np.pi * np.arange(recording.z_mm.shape[1]) / 16.0)
    spoilt = replace(recording, z_mm=(recording.z_mm + wave).astype(np.float32))
    inspection = inspect_as_a_user(spoilt, truth)
    at = truth.arc_length_mm_at(np.array([one.origin_mm for one in inspection.sections]))
    off = np.array([one.bevel_deg for one in inspection.sections])
    off -= np.interp(at, truth.arc_length_mm, truth.bevel_deg)
    u = np.array([one.bevel_u_deg for one in inspection.sections])
    assert np.abs(off).min() > 0.5
    assert np.abs(off / u).max() < 3.5


def test_u_follows_the_linearity_that_is_declared(tmp_path: Path) -> None:
    part, found = walking(41, 0.0), []
    for number, rms in enumerate((0.001, 0.004, 0.016)):
        file = tmp_path / f"sensor{number}.json"
        file.write_text(json.dumps({"filters": None, "body": None, "linearity_mm": rms, "linearity_length_mm": 4.0}))
        found.append(float(np.nanmedian(measured(part, sensor=file).bevel.u_by_source[FORM])))
    assert found[1] / found[0] == pytest.approx(4.0, rel=0.2)
    assert found[2] / found[1] == pytest.approx(4.0, rel=0.05)


def test_a_sensor_file_with_another_unit_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "sensor.json"
    file.write_text(json.dumps({"linearity_mm": -1}))
    with pytest.raises(WorkbenchError, match=r"sensor\.json: \$\.linearity_mm"):
        measured(walking(41, 0.0), sensor=file)


def test_a_place_that_is_missing_changes_little() -> None:
    """Places of a face that no frame shows, also beside its end."""
    rng, place_mm = np.random.default_rng(3), np.linspace(-6.0, 6.0, 25)
    walk = 0.003 * np.cumsum(rng.standard_normal(25)) * np.sqrt(0.5)
    noise = 1e-7 * np.eye(25)

    def turn_u(there: Int) -> float:
        image = FaceImage(np.zeros(1), walk[None, there], noise[None, there][:, :, there], place_mm[there], 1.05)
        return float(forms([image], np.zeros(1), Linearity())[0].turn_u[0])

    for missing in range(1, 24):
        assert turn_u(np.delete(np.arange(25), missing)) == pytest.approx(turn_u(np.arange(25)), rel=0.2)


@pytest.mark.parametrize(("begin", "end", "end_mm"), [(9, 16, 0.03), (5, 9, 0.0), (0, 4, 0.03)])
def test_the_line_goes_without_a_part_that_stands_aside(begin: int, end: int, end_mm: float) -> None:
    """A step, a second return in the middle; an end of the face is that of the part there, or not: half of it in u."""
    place_mm = np.linspace(-0.75, 0.75, 16)
    part = np.where((np.arange(16) >= begin) & (np.arange(16) < end), 0.06, 0.0)
    line = np.polynomial.Polynomial.fit(place_mm, part, 1).convert()
    noise = np.random.default_rng(5).normal(0.0, 1e-3, 16)
    image = FaceImage(np.zeros(1), (part + noise - line(place_mm))[None], 1e-6 * np.eye(16)[None], place_mm, 1.0)
    form = forms([image], np.zeros(1), Linearity())[0]
    assert form.turn[0] == pytest.approx(line.coef[1], abs=1e-3)
    assert form.turn_u[0] < 0.5 * DEG
    side = form.lower_u_mm if end == 16 else form.upper_u_mm
    assert side[0] == pytest.approx(end_mm, abs=0.01)


def test_noise_alone_turns_no_line() -> None:
    place_mm, rng = np.linspace(-0.75, 0.75, 16), np.random.default_rng(6)
    for _ in range(20):
        image = FaceImage(np.zeros(1), rng.normal(0.0, 1e-3, (1, 16)), 1e-6 * np.eye(16)[None], place_mm, 1.0)
        form = forms([image], np.zeros(1), Linearity())[0]
        assert abs(form.turn[0]) < 0.1 * form.turn_u[0]


def test_a_root_face_in_two_levels_has_the_angle_of_both() -> None:
    """The lower part stands back by 0.07 mm: a line through both has 3.3 deg more."""
    part = odd_plate("lower part of the root face stands back", 3015, False)
    edge = measured(part)
    off = (edge.bevel.value - part.section.bevel / DEG)[edge.seen]
    assert any("a part of the root face stands aside by 0.0" in one for one in edge.warnings)
    assert np.abs(off).max() < 0.4
    assert np.abs(off / edge.bevel.u[edge.seen]).max() < 4.0
