"""What a scene holds: the points that tell most, deviations that are true, and a text that no file can break out of."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, UPPER_SURFACE, Chapter, Mark, Scene, Shading, Strokes
from workbench.report import closed_loop, html, inspection, plan
from workbench.report.html import packed
from workbench.report.scenes import (
    UNKNOWN,
    along,
    always,
    by_deviation,
    deviation_mm,
    inspection_scene,
    laid_out_faces,
    loop_scene,
    telling,
)
from workbench.units import DEG

NOISE_MM = 0.012  # of the parts in conftest


def unpacked(text):
    """Base positions of a packed scene's points, and the shadings' indices."""
    scene = json.loads(text)
    steps = np.frombuffer(base64.b64decode(scene["points"]), "<i2").reshape(-1, 3)
    counts = [block[4] for block in scene["blocks"]]
    middle, step = (
        np.repeat(np.array(each), counts, axis=0)
        for each in zip(*[(b[:3], b[3]) for b in scene["blocks"]], strict=True)
    )
    position = np.array(scene["origin"]) + middle + step[:, None] * steps
    return position, [np.frombuffer(base64.b64decode(each["index"]), np.uint8) for each in scene["shadings"]]


def along_the_edge(scene, count):
    """The first points of a scene in the order in which they are packed."""
    first = scene.points_mm[:count]
    return first[np.argsort(first @ scene.axes[0], kind="stable")]


@pytest.fixture(scope="module")
def dense(part):
    """An arc with no clamp and no waves hidden, more points than a scene takes."""
    return part(radius_mm=400.0, frames=300, columns=400, clamp=(-2.0, -1.0))


def test_corners_are_kept_and_the_rest_is_spread_evenly(dense):
    budget = 12_000
    points = telling(dense.cloud, dense.edge, budget)
    assert 0.85 * budget < len(points.label) <= budget
    assert len(np.unique(points.frame * 400 + points.column)) == len(points.label)
    assert dense.cloud.keep[points.frame, points.column].all()
    frames, columns = dense.edge.labels.shape
    near = np.zeros((frames, columns), bool)  # within three columns of an end of a face
    for k, labels in enumerate(dense.edge.labels):
        for face in (ROOT_FACE, BEVEL_FACE, UPPER_SURFACE):
            for end in np.flatnonzero(labels == face)[[0, -1]]:
                near[k, max(0, end - 3) : end + 4] = True
    taken = near[points.frame, points.column]
    assert np.sum(taken) / np.sum(near) > 3.0 * np.sum(~taken) / np.sum(~near)
    assert np.mean(taken) < 0.6
    share = np.histogram(points.position_mm @ dense.inspection.sections[4].tangent, bins=20)[0] / len(points.label)
    assert share.max() < 2.2 * share.min()


def test_any_first_part_of_the_points_shows_the_whole(dense):
    points = telling(dense.cloud, dense.edge, 12_000)
    first = points.label[:3_000]
    for face in (ROOT_FACE, BEVEL_FACE, UPPER_SURFACE):
        assert np.mean(first == face) == pytest.approx(np.mean(points.label == face), abs=0.03)
    np.testing.assert_allclose(
        np.ptp(points.position_mm[:3_000], axis=0), np.ptp(points.position_mm, axis=0), rtol=0.02
    )


def test_deviations_are_noise_about_the_true_faces_and_see_a_wrong_size(dense):
    """Against the parts' own formula; a root of 0.1 mm more moves the bevel in by 0.1 sin(beta)."""
    from tests.report.conftest import angle_deg_at, root_at

    points = telling(dense.cloud, dense.edge, 20_000)
    off = deviation_mm(points, laid_out_faces(points, dense.cloud, dense.edge), root_at, angle_deg_at)
    assert np.isnan(off[points.label == UPPER_SURFACE]).all()
    for face in (ROOT_FACE, BEVEL_FACE):
        known = off[(points.label == face) & np.isfinite(off)]
        assert abs(np.mean(known)) < 5 * NOISE_MM / np.sqrt(len(known)) + 5e-4
        assert np.std(known) < 1.2 * NOISE_MM
    larger = deviation_mm(
        points, laid_out_faces(points, dense.cloud, dense.edge), lambda s: root_at(s) + 0.1, angle_deg_at
    )
    on_bevel = points.label == BEVEL_FACE
    np.testing.assert_allclose((larger - off)[on_bevel], -0.1 * np.sin(angle_deg_at(0.0) * DEG), atol=2e-3)


def test_values_along_the_edge_have_no_value_in_gaps():
    at = along(np.array([0.0, 1.0, 2.0, 30.0, 31.0]), np.array([1.0, 2.0, np.nan, 4.0, 6.0]))
    np.testing.assert_allclose(at(np.array([0.5, 1.0, 30.5])), [1.5, 2.0, 5.0])
    assert np.isnan(at(np.array([15.0, -5.0, 40.0, np.nan]))).all()
    assert np.isnan(along(np.array([]), np.array([]))(np.array([1.0]))).all()


def test_the_legend_names_the_colours_of_the_palette(dense):
    points = telling(dense.cloud, dense.edge, 10_000)
    shading = by_deviation("x", points, laid_out_faces(points, dense.cloud, dense.edge), always(1.5), always(40.0))
    limit = float(shading.legend[-2][0].split()[0])
    off = deviation_mm(points, laid_out_faces(points, dense.cloud, dense.edge), always(1.5), always(40.0))
    known = np.isfinite(off)
    assert np.mean(np.abs(off[known]) > limit) < 0.01
    np.testing.assert_allclose(shading.index[known] / 127.0 - 1.0, np.clip(off[known] / limit, -1, 1), atol=0.004)
    assert set(shading.index[np.isnan(off)]) == {UNKNOWN}
    assert "#{:02x}{:02x}{:02x}".format(*shading.palette[254]) == shading.legend[-2][1]
    assert "#{:02x}{:02x}{:02x}".format(*shading.palette[UNKNOWN]) == shading.legend[-1][1]


def test_packing_keeps_the_points_within_micrometres(dense):
    scene = inspection_scene(dense.cloud, dense.edge, dense.inspection, 30_000)
    position, indices = unpacked(packed(scene, 20_000))
    np.testing.assert_allclose(position, along_the_edge(scene, 20_000), rtol=0.0, atol=0.001)
    assert [len(index) for index in indices] == [20_000] * 3


def test_a_five_metre_edge_is_as_fine():
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(0, 5000, 200_000), rng.uniform(0, 20, 200_000), rng.uniform(0, 10, 200_000)])
    shading = Shading("face", np.zeros(200_000, np.uint8), np.zeros((1, 3), np.uint8), ())
    scene = Scene(points, (shading,), (), (), np.eye(3))
    position, _ = unpacked(packed(scene, 200_000))
    np.testing.assert_allclose(position, along_the_edge(scene, 200_000), rtol=0.0, atol=0.002)


def test_no_text_ends_the_script(hostile):
    attack = "</script><!--\u2028" + hostile
    mark = Mark(attack, np.zeros(3), np.eye(3), "#000000", ((attack, attack),))
    line = Strokes(attack, (np.eye(3),), (np.zeros((3, 3), np.uint8),))
    text = packed(Scene(np.zeros((0, 3)), (), (line,), (mark,), np.eye(3), attack), 10)
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text)["marks"][0]["facts"] == [[attack, attack]]


def test_the_page_stays_small_and_shares_the_points_out(elements):
    """Three chapters that bring 400,000 points each: 300,000 on the page."""
    rng = np.random.default_rng(5)
    index = rng.integers(0, 255, 400_000).astype(np.uint8)
    shadings = tuple(Shading(f"{k}", index, np.zeros((255, 3), np.uint8), ()) for k in range(3))
    scene = Scene(rng.uniform(0, 1000, (400_000, 3)), shadings, (), (), np.eye(3))
    chapters = [Chapter(f"{k}", '<figure class="space"></figure>', scene=scene) for k in range(3)]
    page = html(tuple(chapters)).content
    assert len(page) < 15e6
    scenes = [json.loads(text) for text in elements(page.decode()).scripts[:-1]]
    assert [sum(block[4] for block in each["blocks"]) for each in scenes] == [100_000] * 3


def test_a_page_without_a_scene_brings_no_script(elements):
    page = html((Chapter("Plan", "<p>ten layers</p>"),)).content.decode()
    assert "<script" not in page
    policy = next(dict(a)["content"] for tag, a in elements(page).tags if tag == "meta" and "http-equiv" in a)
    assert "script-src 'none'" in policy
    assert "default-src 'none'" in policy


def test_each_chapter_of_the_house_has_its_scene_and_its_place(part, planned, by_formula, quick):
    made, raw = part(frames=60, columns=80), planned(frames=60, columns=60)
    chapters = (
        inspection(made.cloud, made.edge, made.inspection),
        plan(raw.cloud, raw.edge, raw.toolpath),
        closed_loop(made.inspection, by_formula()),
    )
    for chapter in chapters:
        assert chapter.html.count('<figure class="space">') == 1
        rows = {mark.key for mark in chapter.scene.marks}
        assert rows
        assert all(f'data-mark="{key}"' in chapter.html + chapter.certificate for key in rows)
    assert len(chapters[2].scene.points_mm) == 0
    assert chapters[1].scene.marks_are == "layers"


def test_the_closed_loop_is_shown_on_the_milled_part_only(part, planned, by_formula):
    made, raw, path = part(frames=60, columns=80), planned(frames=60, columns=60), by_formula()
    from workbench.report.planned import compared

    rows = compared(made.inspection, path)
    assert len(loop_scene(made.inspection, path, rows, made.cloud, made.edge, 5_000).points_mm) > 1_000
    assert len(loop_scene(made.inspection, path, rows, raw.cloud, raw.edge, 5_000).points_mm) == 0
