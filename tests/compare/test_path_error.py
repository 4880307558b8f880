"""What two scans of one part must not call a change: errors of the path, streaks of returns, passes apart."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bench.drawn.plates import random_recipe
from workbench.artefacts import Check, Document
from workbench.cloud import denoise
from workbench.compare import deviation, register, surface
from workbench.compare.statistics import path_error_u
from workbench.compare.surface_stage import Deviations, Surface
from workbench.scan import fuse
from workbench.synthetic import Recipe, simulate_recording
from workbench.units import DEG, Float

NORMALS = np.array([[0.0, 0.0, 1.0], [0.0, np.sin(40 * DEG), np.cos(40 * DEG)], [0.0, 1.0, 0.0]])
FACES = np.array([[0.0, -9.0, 0.0], [0.0, -3.0, -1.5], [0.0, 0.0, -4.0]])  # middles in the section


def places() -> tuple[Float, Float, Float, Float]:
    """Position, normal, arc length and face number of places on upper surface, bevel and root face."""
    arc, face, beside = (x.ravel() for x in np.meshgrid(np.arange(60.0), [0, 1, 2], [-1.0, 0.0, 1.0], indexing="ij"))
    normal = NORMALS[face.astype(int)]
    across = np.cross(normal, [1.0, 0.0, 0.0])
    position = FACES[face.astype(int)] + arc[:, None] * [1.0, 0.0, 0.0] + beside[:, None] * across
    return position, normal, arc, face


@pytest.mark.parametrize("shift", [(0.05, 0.0), (0.0, 0.05), (0.03, -0.04)])
def test_a_shared_shift_is_the_path_s(shift: tuple[float, float]) -> None:
    """Faces that move together by a wave along the edge lie within 2 u wherever they lie."""
    position, normal, arc, _ = places()
    moved = np.sin(arc / 15.0)[:, None] * np.array([0.0, *shift])
    distance = (normal * moved).sum(axis=1)
    u = path_error_u(position, distance, normal, arc)
    assert (np.abs(distance) < 2.0 * u + 1e-9).all()
    assert np.median(u) < 0.05


@pytest.mark.parametrize("changed", [0, 1, 2])
def test_a_change_of_one_face_is_none(changed: int) -> None:
    position, normal, arc, face = places()
    distance = np.where(face == changed, 0.05 * np.sin(arc / 15.0), 0.0)
    u = path_error_u(position, distance, normal, arc)
    assert u.max() < 1e-6


def test_one_face_tells_nothing() -> None:
    position, normal, arc, face = places()
    for those in (face == 1, face != 1):  # the second: at right angles
        assert path_error_u(position[those], np.zeros(those.sum()), normal[those], arc[those]) is None


def twice(condition: str, seed: int) -> list[Surface]:
    """One part, scanned twice, in fewer frames than a scanner takes."""
    recipe = random_recipe(condition, seed)
    recipe = recipe.model_copy(update={"robot": recipe.robot.model_copy(update={"frame_pitch_mm": 0.6})})
    again = Recipe.model_validate({**recipe.model_dump(), "seed": recipe.seed + 77})
    return [surface(denoise(fuse(simulate_recording(one)[0]))) for one in (again, recipe)]


def compared(scan: Surface, reference: Surface) -> tuple[Deviations, Document]:
    registration = register(scan, reference, open_directions="hold")[0]
    found, document, _ = deviation(scan, reference, registration, spacing_mm=4.0)
    return found, document


def test_a_path_that_errs_is_no_change() -> None:
    """A robot that errs smoothly by 0.1 mm: thousands of places lie beyond their noise, and none is called changed."""
    found, document = compared(*twice("robot_error", 8_920_103))
    content = json.loads(document.content)
    assert not content["changed"], content["finding"]
    assert content["rms_mm"] > 3.0 * content["uncertainty"]["median_u_mm"]["noise of both surfaces"]
    z = found.distance_mm / found.u_mm
    assert np.nanmax(np.abs(z)) < 4.0


def test_passes_that_disagree_are_in_u() -> None:
    """Half of the squared distance between passes, of either side; not known: what is stated of the place."""
    scan, reference = twice("two_pass", 8_920_109)
    assert scan.passes_apart_mm is not None
    _, document = compared(scan, reference)
    content = json.loads(document.content)
    expected = np.hypot(scan.passes_apart_mm, reference.passes_apart_mm) / np.sqrt(2.0)
    assert content["uncertainty"]["median_u_mm"]["passes of a scan beside each other"] == pytest.approx(expected)
    assert not content["changed"]
    assert all(Check(**one).passed for one in content["checks"]["scan"])
