"""What a scene holds: the points that tell most, deviations that are true, and a text that no file can break out of."""

from __future__ import annotations

import base64
import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from tests.report.conftest import angle_deg_at, root_at
from workbench.artefacts import BEVEL_FACE, ROOT_FACE, UPPER_SURFACE, Chapter, Mark, Scene, Shading, Strokes
from workbench.report import closed_loop, html, inspection, plan
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


@pytest.fixture(scope="module")
def dense(part):
    """An arc with no clamp and no waves hidden, more points than a scene takes."""
    return part(radius_mm=400.0, frames=300, columns=400, clamp=(-2.0, -1.0))


BUDGET = 20_000


@pytest.fixture(scope="module")
def scene(dense):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("workbench.report.scene.picture", lambda view: b"\x89PNG")  # not looked at here
        return inspection(dense.cloud, dense.edge, dense.inspection, points=BUDGET).scene


@pytest.fixture(scope="module")
def places(dense, scene):
    """Where in the cloud's grid the scene's points are, as one number: each is one of its kept points, at its place."""
    cloud = dense.cloud
    profile = np.stack([cloud.x_mm, 0 * cloud.x_mm, cloud.z_mm], axis=-1).astype(float)
    pose = cloud.base_from_profiler
    every = np.einsum("nij,nmj->nmi", pose[:, :3, :3], profile) + pose[:, None, :3, 3]
    kept = np.flatnonzero(cloud.keep)
    off, nearest = cKDTree(every.reshape(-1, 3)[kept]).query(scene.points_mm)
    assert off.max() < 1e-6
    return kept[nearest]


def label_of(scene):
    return scene.shadings[0].index


def test_corners_are_kept_and_the_rest_is_spread_evenly(dense, scene, places):
    assert 0.85 * BUDGET < len(places) <= BUDGET
    assert len(np.unique(places)) == len(places)
    near = np.zeros(dense.edge.labels.shape, bool)  # within three columns of an end of a face
    for k, labels in enumerate(dense.edge.labels):
        for face in (ROOT_FACE, BEVEL_FACE, UPPER_SURFACE):
            for end in np.flatnonzero(labels == face)[[0, -1]]:
                near[k, max(0, end - 3) : end + 4] = True
    taken = near.ravel()[places]
    assert np.sum(taken) / np.sum(near) > 3.0 * np.sum(~taken) / np.sum(~near)
    assert np.mean(taken) < 0.6
    share = np.histogram(scene.points_mm @ dense.inspection.sections[4].tangent, bins=20)[0] / len(places)
    assert share.max() < 2.2 * share.min()


def test_any_first_part_of_the_points_shows_the_whole(scene):
    label, first = label_of(scene), label_of(scene)[:3_000]
    for face in (ROOT_FACE, BEVEL_FACE, UPPER_SURFACE):
        assert np.mean(first == face) == pytest.approx(np.mean(label == face), abs=0.03)
    np.testing.assert_allclose(np.ptp(scene.points_mm[:3_000], axis=0), np.ptp(scene.points_mm, axis=0), rtol=0.02)


def laid_out(scene):
    """Arc length, u and v of the points along the arc of 400 mm."""
    x, y, z = (scene.points_mm - [1200.0, -300.0, 800.0]).T
    return 400.0 * np.arctan2(x, -y), np.hypot(x, y) - 400.0, z


def outside_mm(scene, root_mm=root_at, bevel_deg=angle_deg_at):
    """How far each point lies outside the faces; NaN off root and bevel face."""
    s, u, v = laid_out(scene)
    beta, label = bevel_deg(s) * DEG, label_of(scene)
    bevel = np.cos(beta) * u + np.sin(beta) * (v - root_mm(s))
    return np.select([label == ROOT_FACE, label == BEVEL_FACE], [u, bevel], np.nan)


def shaded(shading):
    """The deviation that each point's colour stands for, and the greatest of the palette."""
    limit = float(shading.legend[-2][0].split()[0])
    return np.where(shading.index == 255, np.nan, (shading.index / 127.0 - 1.0) * limit), limit


def test_colours_are_the_deviations_from_the_faces(scene):
    """From the measured ones, which are the true ones but for 4 um and 0.03 deg, and from the nominal ones."""
    nominal = outside_mm(scene, lambda s: 1.5 + 0 * s, lambda s: 40.0 + 0 * s)
    for shading, true, within in zip(scene.shadings[1:], (outside_mm(scene), nominal), (0.02, 0.002), strict=True):
        off, limit = shaded(shading)
        known = np.isfinite(true)
        np.testing.assert_array_equal(np.isfinite(off), known)
        assert np.mean(np.abs(true[known]) > limit) < 0.01
        np.testing.assert_allclose(off[known], np.clip(true[known], -limit, limit), atol=within + limit / 127.0)
    off, _ = shaded(scene.shadings[1])
    for face in (ROOT_FACE, BEVEL_FACE):
        known = off[(label_of(scene) == face) & np.isfinite(off)]
        assert abs(np.mean(known)) < 5 * NOISE_MM / np.sqrt(len(known)) + 1e-3
        assert np.std(known) < 1.2 * NOISE_MM


def test_the_legend_names_the_colours_of_the_palette(scene):
    faces = {name for name, _ in scene.shadings[0].legend}
    assert {"root face", "bevel face", "upper surface"} <= faces
    assert "lower surface" not in faces
    for shading in scene.shadings[1:]:
        assert "#{:02x}{:02x}{:02x}".format(*shading.palette[254]) == shading.legend[-2][1]
        assert "#{:02x}{:02x}{:02x}".format(*shading.palette[255]) == shading.legend[-1][1]


def test_fitted_lines_go_along_the_root_face_and_up_the_bevel(dense, scene):
    (lines,) = [one.lines_mm for one in scene.strokes if one.name == "fitted lines of the sections"]
    for line, s in zip(lines, dense.inspection.sections, strict=True):
        u, v = ((line - s.origin_mm) @ one for one in (s.normal, s.across))
        np.testing.assert_allclose((u[:2], v[:2]), [(0.0, 0.0), (0.0, s.values["root_mm"])], atol=1e-9)
        assert v[2] == pytest.approx(10.0, abs=0.1)  # the upper surface
        assert u[2] == pytest.approx(-(v[2] - s.values["root_mm"]) * np.tan(s.values["bevel_deg"] * DEG))


def test_what_was_not_measured_has_no_deviation(part, quick):
    p = part(radius_mm=400.0, frames=100, columns=100)
    profile = p.inspection.profile
    unknown = (profile.arc_length_mm > 20) & (profile.arc_length_mm < 40)
    root = np.where(unknown, np.nan, profile.root_mm)
    inspected = dataclasses.replace(p.inspection, profile=dataclasses.replace(profile, root_mm=root))
    scene = inspection(p.cloud, p.edge, inspected).scene
    s, bevel = laid_out(scene)[0], label_of(scene) == BEVEL_FACE
    off, _ = shaded(scene.shadings[1])
    assert np.isnan(off[bevel & (s > 21) & (s < 39)]).all()
    assert np.isfinite(off[bevel & ((s < 19) | ((s > 41) & (s < 85)))]).mean() > 0.98


def scenes_in(elements, *chapters):
    """Positions and indices of each scene of a page, in the order in which the points are packed."""
    return [unpacked(text) for text in elements(html(chapters).content.decode()).scripts[:-1]]


def in_space(scene):
    return Chapter("Inspection", '<figure class="space"></figure>', scene=scene)


def test_packing_keeps_the_points_within_micrometres(scene, elements):
    ((position, indices),) = scenes_in(elements, in_space(scene))
    along = np.argsort(scene.points_mm @ scene.axes[0], kind="stable")
    np.testing.assert_allclose(position, scene.points_mm[along], rtol=0.0, atol=0.001)
    for index, shading in zip(indices, scene.shadings, strict=True):
        np.testing.assert_array_equal(index, shading.index[along])


def test_a_five_metre_edge_is_as_fine(elements):
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(0, 5000, 200_000), rng.uniform(0, 20, 200_000), rng.uniform(0, 10, 200_000)])
    shading = Shading("face", np.zeros(200_000, np.uint8), np.zeros((1, 3), np.uint8), ())
    ((position, _),) = scenes_in(elements, in_space(Scene(points, (shading,), (), (), np.eye(3))))
    np.testing.assert_allclose(position, points[np.argsort(points[:, 0], kind="stable")], rtol=0.0, atol=0.002)


def test_no_text_ends_the_script(hostile, elements):
    attack = "</script><!--\u2028" + hostile
    mark = Mark(attack, np.zeros(3), np.eye(3), "#000000", ((attack, attack),))
    line = Strokes(attack, (np.eye(3),), (np.zeros((3, 3), np.uint8),))
    page = elements(html((in_space(Scene(np.eye(3), (), (line,), (mark,), np.eye(3), attack)),)).content.decode())
    assert page.scripts_are_the_reports_own()
    assert not set("<>&\u2028") & set(page.scripts[0])
    assert json.loads(page.scripts[0])["marks"][0]["facts"] == [[attack, attack]]


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
    on_milled, on_raw = (
        closed_loop(made.inspection, path, cloud=one.cloud, edge=one.edge).scene.points_mm for one in (made, raw)
    )
    assert len(on_milled) > 1_000
    assert len(on_raw) == 0
