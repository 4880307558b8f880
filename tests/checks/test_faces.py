"""What is no bevel is refused before a size of it is told: twelve kinds of shapes, odd plates, grooves, real files.

Two draws of a kind here; `python -m bench.confidently_wrong` takes hundreds.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.confidently_wrong.shapes import SHAPES, shape_recording
from bench.drawn.grooves import random_groove_recipe, random_prism_recipe
from bench.drawn.plates import random_recipe
from bench.drawn.swept import random_swept_recipe
from bench.odd_plates import (
    DEBURRED,
    SURROUNDED,
    Sizes,
    compound,
    drawn_above,
    j_shape,
    judged,
    ledge,
    odd_plate,
    plain,
    plate,
)
from bench.outside import Part, Section, Wide, simulate
from bench.outside import inspected as judged_inspection
from bench.outside import planned as judged_plan
from bench.recordings import with_grid
from bench.score.face import rough_upper_side
from bench.simulators.swept import simulate_groove, simulate_swept
from bench.simulators.swept.sweep import GROOVES
from tests.checks.conftest import good
from tests.seldom import seldom
from workbench.artefacts import Gate, RawEdge, Recording
from workbench.checks.corners import ledge_takes_mm
from workbench.checks.faces import Shown, require_bevel
from workbench.checks.straightness import _shape
from workbench.cloud import denoise
from workbench.cloud import read as read_cloud
from workbench.edge import segment, segment_cloud, segment_raw
from workbench.edge.groove_frames import two_plates_share
from workbench.errors import InputError, WorkbenchError
from workbench.inspect import gate, sections
from workbench.scan import fuse
from workbench.synthetic import simulate_prism, simulate_recording
from workbench.synthetic.recipe import PrismRecipe
from workbench.units import DEG

REAL = Path(__file__).parents[3] / "shared" / "data"


def inspected(recording: Recording) -> Gate:
    return gate(sections(segment(denoise(fuse(recording)))))


def test_upper_surface_and_bevel_face_are_no_bevel_face_and_root_face() -> None:
    """A view from above that does not show the root face: the angle tells, where no further surface does."""
    cloud = denoise(fuse(good()))
    edge = segment(cloud)
    shown = Shown(0.0, 1.0, 1.0, False, False, 36.0, 55.0, 5.0, False)
    with pytest.raises(InputError, match=r"a bevel face of 54.0 deg would: is the root face in view"):
        require_bevel(cloud, edge.labels, shown)
    for known in (shown._replace(upper_seen=True), shown._replace(lower_seen=True), shown._replace(bevel_deg=46.0)):
        assert all(check.passed for check in require_bevel(cloud, edge.labels, known))


@pytest.mark.parametrize("kind", SHAPES)
def test_what_is_no_bevel_is_refused(kind: str) -> None:
    told = []
    for seed in range(2):
        with contextlib.suppress(WorkbenchError):
            told.append((seed, inspected(shape_recording(kind, seed)).reason))
    assert told == []


def test_sides_that_overlap_are_read() -> None:
    """An ordinary edge, in a profile of which strays make two plates whose last returns lie the wrong way round."""
    recording, _ = simulate_recording(random_recipe("outliers_5", 1_000_015))
    assert two_plates_share(denoise(fuse(recording))) < 0.1


BOTH = [*zip(GROOVES, itertools.cycle(["swept", "prism"]), strict=False)]


def shortened(recipe: PrismRecipe) -> PrismRecipe:
    """The first 30 mm of its pass."""
    (one,) = recipe.passes
    end = one.from_mm + math.copysign(30.0, one.to_mm - one.from_mm)
    return recipe.model_copy(update={"passes": (one.model_copy(update={"to_mm": end}),)})


@pytest.mark.parametrize(("kind", "simulator"), [*BOTH[:4], *seldom(*BOTH[4:])])
def test_a_groove_is_no_bevel_and_no_raw_edge(kind: str, simulator: str) -> None:
    made = {
        "swept": lambda: simulate_groove(random_groove_recipe(kind, 321)),
        "prism": lambda: simulate_prism(shortened(random_prism_recipe(kind, 321))),
    }
    recording, _ = made[simulator]()
    cloud = denoise(fuse(recording))
    assert two_plates_share(cloud) > 0.8
    with pytest.raises(InputError):
        segment(cloud)
    with pytest.raises(InputError, match=r"no raw edge: 1?[0-9]+ % of the profiles show two plates with a groove"):
        segment_raw(cloud, upper_side=(0.0, 0.0, 1.0))


def rows_of(file: str) -> tuple[np.ndarray, np.ndarray]:
    """x and z (n, columns) in mm of a real file of profiles; one profile alone goes on along its part, with noise."""
    text = (REAL / file).read_text().splitlines()
    if file.endswith("gocator_surface_v2.csv"):
        cells = [line.split(",") for line in text]
        first = next(i for i, row in enumerate(cells) if row[0] == r"Y\X") + 1
        z = numbers([row[1:] for row in cells[first:]])
        return np.broadcast_to(np.arange(z.shape[1]) * 0.3, z.shape), 150.0 - z
    if file.endswith("vgroove_lds_scan1.csv"):  # counts: of 0.05 mm the groove has the size of a weld's
        z = numbers([line.split(",") for line in text[1:]])
        z[z == 0] = np.nan
        return np.broadcast_to(np.arange(z.shape[1]) * 0.05, z.shape), z * (60.0 / np.nanmax(z))
    if file.endswith("scancontrol_2925.csv"):
        z = numbers([line.replace(",", ".").split(";") for line in text if line.strip()])
        third = len(z) // 3
        return z[:third], z[2 * third :]
    separator, columns = (";", [0, 1]) if file.endswith("lps_profile.csv") else (",", [1, 2])
    x, z = numbers([line.split(separator) for line in text if line[:1] in "-0123456789"])[:, columns].T
    z[z < -900] = np.nan
    rng = np.random.default_rng(7)
    return np.broadcast_to(x, (200, x.size)), z + rng.normal(0, 0.005, (200, x.size))


def numbers(rows: list[list[str]]) -> np.ndarray:
    widest = max(map(len, rows))
    return np.array([[float(c) if c.strip() else np.nan for c in row] + [np.nan] * (widest - len(row)) for row in rows])


REAL_PROFILES = [
    "vendor/gocator_surface_v2.csv",
    "vendor/gopxl_profile.csv",
    "vendor/scancontrol_2925.csv",
    "real/vgroove_lds_scan1.csv",
    "real/lps_profile.csv",
]


def raw_edge(recording: Recording) -> RawEdge:
    return segment_raw(denoise(fuse(recording)), upper_side=(0.0, 0.0, 1.0))


@pytest.mark.parametrize("file", REAL_PROFILES)
@pytest.mark.parametrize("judge", [inspected, raw_edge])
def test_what_real_sensors_saw_and_is_no_bevel_is_refused(file: str, judge: Callable[[Recording], object]) -> None:
    if not (REAL / file).is_file():
        pytest.skip("real files are not beside this checkout")
    x, z = rows_of(file)
    which = np.linspace(0, len(z) - 1, 200).astype(int)
    recording = with_grid(shape_recording("empty table", 0), x[which], z[which])
    with pytest.raises(WorkbenchError):
        judge(recording)


@pytest.mark.parametrize(("file", "unit"), [("real/trispector_table.pcd", "m"), ("real/nist_SPH105_metres.xyz", "m")])
def test_real_clouds_without_a_bevel_are_refused(file: str, unit: str) -> None:
    if not (REAL / file).is_file():
        pytest.skip("real files are not beside this checkout")
    with pytest.raises(WorkbenchError):
        segment_cloud(read_cloud(file=REAL / file, unit=unit))


def test_columns_too_coarse_for_the_root_face_are_refused() -> None:
    """Of a face that is not found, the neighbours pass for it: upper surface and bevel face for bevel and root face."""
    recording = simulate_recording(random_recipe("straight", 61))[0]
    coarse = replace(recording, x_mm=recording.x_mm[:, ::8], z_mm=recording.z_mm[:, ::8], intensity=None)
    with pytest.raises(InputError, match=r"columns are 0\.4 mm apart.*root_columns"):
        segment(fuse(coarse), root_nominal_mm=2.0)


def test_faces_that_the_view_cuts_off_are_refused() -> None:
    recording = simulate_recording(random_recipe("two_pass", 6_100_003))[0]
    seen = np.flatnonzero(np.isfinite(recording.z_mm).any(axis=0))
    keep = np.arange(recording.z_mm.shape[1]) < seen[len(seen) // 2]
    cut = replace(recording, x_mm=recording.x_mm[:, keep], z_mm=recording.z_mm[:, keep], intensity=None)
    with pytest.raises(InputError, match=r"lower end is in view|lower edge not in view"):
        segment(fuse(cut), root_nominal_mm=1.5, bevel_nominal_deg=40.0)


def test_a_bevel_of_which_only_a_part_is_straight_is_refused() -> None:
    """A concave bevel of 0.09 mm is parted into two lines; the lower one alone is 2.3 deg off."""
    recording = simulate_swept(random_swept_recipe("swept_bowed", 5_130_000))[0]
    with pytest.raises(InputError, match=r"goes on.*goes_on_share"):
        segment(denoise(fuse(recording)), root_nominal_mm=2.0, bevel_nominal_deg=45.0)


ODD = {
    "compound by 5 deg": compound(35.0, 40.0, 0.5, 6.0),
    "compound by 27 deg, the lower face short": compound(28.0, 55.0, 0.3, 6.0),  # root face and bevel of the upper two
    "compound, the upper face steeper": compound(45.0, 25.0, 0.6, 6.0),
    "a land above the bevel": ((-4.2, 5.0), (-4.2, 6.5)),
    "a nose": ledge(1.0, 35.0, 6.0),
    "a ledge": ledge(0.3, 35.0, 6.0),
    "J": j_shape(5.0, 12.0, 0.0, 10.0),
    "J with a land": j_shape(4.0, 15.0, 1.5, 10.0),
}


def odd(name: str, seed: int, is_raw: bool) -> Part:
    corners = ODD[name]
    of = drawn_above(1.5, 35.0 * DEG, corners)
    return simulate(seed, is_raw, of)


@pytest.mark.parametrize(("name", "seed"), [(name, k % 3) for k, name in enumerate(ODD) if "steeper" not in name])
def test_a_plate_that_is_no_plain_bevel_is_refused(name: str, seed: int) -> None:
    with pytest.raises(InputError, match=r"no bevel: |no edge in view"):
        segment(denoise(fuse(odd(name, seed, is_raw=False).recording)), root_nominal_mm=1.5, bevel_nominal_deg=35.0)


@pytest.mark.parametrize(("further_deg", "seed"), [(10.0, 0), *seldom((20.0, 1), (-20.0, 2))])
def test_of_a_compound_bevel_the_face_beside_the_root_face_is_told_and_that_it_is_one(
    further_deg: float, seed: int
) -> None:
    of = drawn_above(1.5, 35.0 * DEG, compound(35.0, 35.0 + further_deg, 0.5, 6.0))
    edge = segment(denoise(fuse(simulate(seed, False, of).recording)), root_nominal_mm=1.5, bevel_nominal_deg=35.0)
    assert "compound" in [one.name for one in edge.unseen if one.is_doubt]
    for size, true in ((edge.root, 1.5), (edge.bevel, 35.0)):
        assert np.nanmax(np.abs(size.value - true) / size.u) < 3.0


@pytest.mark.parametrize(("name", "seed"), [(name, k % 3) for k, name in enumerate(ODD)])
def test_an_edge_that_is_prepared_is_no_raw_edge(name: str, seed: int) -> None:
    part = odd(name, seed, is_raw=True)
    with pytest.raises(InputError):
        segment_raw(denoise(fuse(part.recording)), upper_side=tuple(part.base_from_section[:3, 1].tolist()))


@pytest.mark.parametrize(
    ("shape", "seed", "expected"),
    [
        ("compound bevel", 17, "face_bow"),
        ("nose of 0.5 to 3 mm", 13, "end_face_lean_deg"),
    ],
)
def test_a_refused_raw_edge_names_what_it_is(shape: str, seed: int, expected: str) -> None:
    part = odd_plate(shape, seed, is_raw=True)
    with pytest.raises(InputError, match=rf"prepared already.*{expected}"):
        segment_raw(denoise(fuse(part.recording)), upper_side=tuple(part.base_from_section[:3, 1].tolist()))


@pytest.mark.parametrize("seed", [3302, 3320, *seldom(3311, 3338, 3356)])
def test_an_end_face_with_a_step_is_not_measured_as_one_of_its_levels(seed: int) -> None:
    """A streak of stray returns beside the face is left out; a step that lasts all along the edge is no streak."""
    rng = np.random.default_rng(seed)
    thick, share, step = rng.uniform(4.0, 12.0), rng.uniform(0.3, 0.7), rng.uniform(0.2, 0.8) * rng.choice([-1.0, 1.0])
    levels = ((-step, 0.0), (-step, (1.0 - share) * thick))
    part = simulate(seed, True, drawn_above(share * thick, 0.0, levels))
    turn = part.base_from_section[:3, :3]
    with contextlib.suppress(InputError):  # refused is right, too
        edge = segment_raw(denoise(fuse(part.recording)), upper_side=tuple(turn[:, 1].tolist()))
        off = np.abs((edge.position_mm - part.base_from_section[:3, 3]) @ turn[:, :2])[edge.seen]
        assert (off <= 3.0 * edge.position_u_mm[edge.seen]).all()


@pytest.mark.parametrize("seed", [2813, *seldom(2858, 3016, 3021)])
def test_an_undercut_beyond_the_end_face_is_told(seed: int) -> None:
    """1 mm of the plate stands back below an end face of 7 mm, all but 0.2 to 0.4 mm of it in shadow.

    The end face's lower edge was taken for the plate's (1 mm off).
    """
    part = odd_plate("step of 0.15 to 0.9 mm", seed, is_raw=True)
    with pytest.raises(InputError, match=r"a step, an undercut.*step_share"):
        segment_raw(denoise(fuse(part.recording)), upper_side=tuple(part.base_from_section[:3, 1].tolist()))


@pytest.mark.parametrize("condition", ["raw_rough", *seldom("raw_burrs", "raw_straight", "raw_clamps")])
def test_end_faces_of_raw_plates_pass(condition: str) -> None:
    recording, truth = simulate_recording(random_recipe(condition, 9_300_000))
    edge = segment_raw(denoise(fuse(recording)), upper_side=rough_upper_side(truth))
    value = {check.name: check.value for check in edge.checks}
    assert (value["end_face_lean_deg"] or 0.0) < 12.0
    assert (value["face_bow"] or 0.0) < 0.1
    assert (value["step_share"] or 0.0) < 0.1


def test_a_ledge_that_a_single_frame_does_not_show_is_refused() -> None:
    """0.1 mm: it takes 0.14 mm off the root face; each frame has a few points on it, within their noise."""
    of = drawn_above(1.5, 35.0 * DEG, ledge(0.1, 35.0, 5.0))
    with pytest.raises(InputError, match=r"stands out of them.*corner_stands_out_mm"):
        segment(denoise(fuse(simulate(0, False, of).recording)), root_nominal_mm=1.5, bevel_nominal_deg=35.0)


@pytest.mark.parametrize(
    ("seed", "land_mm", "bevel_deg"), [(3126, 0.043, 45.0), *seldom((3137, 0.035, 48.0), (3132, 0.063, 41.0))]
)
def test_a_ledge_narrower_than_a_column_is_in_the_uncertainty(seed: int, land_mm: float, bevel_deg: float) -> None:
    """The root face is short by what it takes off, 0.03 to 0.09 mm (at 5 to 10 u before); a plain bevel has none."""
    of = drawn_above(1.5, bevel_deg * DEG, ledge(land_mm, bevel_deg, 6.0))
    plain = Section(1.5, 0.0, bevel_deg * DEG, 7.5, 0.0, None)
    found, without = (judged_inspection(simulate(seed, False, section)) for section in (of, plain))
    error, u = found["root, mm"]
    taken = land_mm / np.tan(bevel_deg * DEG)
    assert np.median(error) == pytest.approx(-taken, rel=0.45)
    assert (np.abs(error) / u).max() < 2.0
    assert np.median(u) < 2.0 * taken
    assert np.median(without["root, mm"][1]) < 0.65 * np.median(u)  # what a rounding may hide


def test_a_corner_stands_out_by_what_a_ledge_does() -> None:
    """None, and ledges of 0.03 and 0.06 mm: (11a) turns what they stand out into what they take off."""
    close = {}
    for land_mm in (0.0, 0.03, 0.06):
        corners = ledge(land_mm, 40.0, 6.0) if land_mm else ((-6.0 * np.tan(40.0 * DEG), 6.0),)
        of = drawn_above(1.5, 40.0 * DEG, corners)
        cloud = denoise(fuse(simulate(3002, False, of).recording))
        (check,) = [one for one in segment(cloud, bevel_nominal_deg=40.0).checks if one.name == "close_stands_out_mm"]
        close[land_mm] = float(ledge_takes_mm(check.value, np.array([40.0 * DEG]))[0])
    assert close[0.0] < 0.002
    for land_mm in (0.03, 0.06):
        assert 0.6 < close[land_mm] / (land_mm / np.tan(40.0 * DEG)) < 1.1


@pytest.mark.parametrize("seed", [2917, *seldom(5034, 5064, 5084)])
def test_a_compound_bevel_whose_angles_hardly_differ_is_refused(seed: int) -> None:
    """By 2.3 to 3.5 deg: as one face it was up to 3 deg off its lower one, at 5 u and more."""
    height, share, low, high = {
        2917: (6.6, 0.15, 33.8, 37.2),
        5034: (7.0, 0.31, 49.1, 45.8),
        5064: (4.0, 0.15, 35.4, 38.3),
        5084: (5.0, 0.16, 43.3, 45.6),
    }[seed]
    of = drawn_above(1.5, low * DEG, compound(low, high, share, height))
    with pytest.raises(InputError, match=r"the bevel face has a corner of [23]\.\d deg at \d+ % .*face_bend_deg"):
        judged_inspection(simulate(seed, False, of))


@pytest.mark.parametrize("differ_deg", [0.6, *seldom(-0.8)])
def test_a_smaller_corner_within_the_bevel_face_is_in_its_uncertainty(differ_deg: float) -> None:
    corners = {share: compound(40.0, 40.0 + differ_deg, share, 6.0) for share in (0.2, 0.4)}
    for share, shape in corners.items():
        found = judged_inspection(simulate(5027, False, drawn_above(1.5, 40.0 * DEG, shape)))
        error, u = found["bevel, deg"]
        assert np.median(error) == pytest.approx(differ_deg * (1.0 - share), abs=0.25)
        assert (np.abs(error) / u).max() < 2.5


def test_faces_that_only_their_widths_tell_apart_are_refused() -> None:
    """A bevel face as wide as the root face, neither upper nor lower surface in view: root 0.66 mm off at 8 u."""
    part = simulate(1504, False, None, Wide())
    with pytest.raises(InputError, match=r"read the other way.*readings_apart"):
        judged_inspection(part)
    section, up = part.section, part.base_from_section[:3, 1]  # for the user to say
    given = {"root_nominal_mm": section.root_mm, "bevel_nominal_deg": section.bevel / DEG}
    right, wrong = (segment(denoise(fuse(part.recording)), upper_side=tuple(one), **given) for one in (up, -up))
    off = [np.nanmedian(np.abs(one.root.value - section.root_mm) / one.root.u) for one in (right, wrong)]
    assert off[0] < 3.0 < off[1]
    with pytest.raises(InputError, match=r"edge\.segment\.upper_side: expected a direction across the edge"):
        segment(denoise(fuse(part.recording)), upper_side=tuple(part.base_from_section[:3, 2]), **given)


@pytest.mark.parametrize(
    ("seed", "is_raw"), [(3, False), (22, True), *seldom((12, False), (5, True), (9, False), (14, True))]
)
def test_a_chamfered_lower_edge_is_measured_to_its_virtual_edge_or_to_the_chamfer(seed: int, is_raw: bool) -> None:
    """Seen and taken for a rounding, chamfers put every fifth raw edge, and every twelfth root face, 4 to 70 u off."""
    refused, right, wrong = judged(DEBURRED, range(seed, seed + 1), is_raw)
    assert (refused, right, wrong) == (0, 1, [])


BELOW, ROUNDED, FRONT = "a bevel below as well", "lower edge rounded by 0.15 to 1.2 mm", "a second plate in front"


@pytest.mark.parametrize("seed", [3304, *seldom(3307, 3337)])
def test_a_root_face_above_a_further_bevel_is_no_bevel_face(seed: int) -> None:
    """Upper bevel, root face and lower bevel were read as upper surface, bevel face and root face (27 u)."""
    assert not judged(BELOW, range(seed, seed + 1), is_raw=False)[2]


@pytest.mark.parametrize("seed", [13, *seldom(17)])
def test_an_end_face_above_a_bevel_is_refused(seed: int) -> None:
    """Where returns of the bevel are lost here and there, the face seemed to end beyond its corner (10 u)."""
    with pytest.raises(InputError, match=r"lower edge not in view|goes_on_share"):
        judged_plan(odd_plate(BELOW, seed, is_raw=True))


@pytest.mark.parametrize("seed", [26, *seldom(3301, 3307, 3322)])
def test_large_roundings_are_measured(seed: int) -> None:
    """0.6 to 1.2 mm: 0.3 to 0.8 mm off at up to 10 u where only frames were taken that hardly showed them."""
    assert judged(ROUNDED, range(seed, seed + 1), is_raw=True) == (0, 1, [])


@pytest.mark.parametrize("seed", [4, *seldom(33)])
def test_the_shadow_of_a_second_plate_is_no_end_of_the_root_face(seed: int) -> None:
    """The flank between them grazes the rays and is lost (0.6 mm off at 12 u, 0.2 mm at 30 u)."""
    rng = np.random.default_rng([781, seed, 2])
    part = simulate(seed, False, SURROUNDED[FRONT](rng, plain(rng, is_raw=False)))
    with pytest.raises(InputError, match="root_seen_share"):
        judged_inspection(part)


def test_an_undercut_that_shows_two_returns_a_frame_is_told() -> None:
    """0.08 mm of it stand out of the shadow: the end face's lower edge was taken for the plate's (1.3 mm off)."""
    with pytest.raises(InputError, match="step_share"):
        judged_plan(odd_plate("step of 0.15 to 0.9 mm", 3216, is_raw=True))


@pytest.mark.parametrize(("lies_on", "seed"), [(True, 8), (False, 8)])
def test_the_rounded_edge_of_a_root_face_is_no_corner_within_it(lies_on: bool, seed: int) -> None:
    section = Section(2.0, 0.0, 35.0 * DEG, 7.0, 0.42, 0.0 if lies_on else None)
    part = simulate(seed, False, section)
    error, u = judged_inspection(part)["root, mm"]
    assert (np.abs(error) < 3.0 * u).all()


def test_the_end_face_of_a_strip_below_a_plate_is_not_the_plates() -> None:
    strip = ((7.0, -6.0), (7.0, 0.0), (-60.0, 0.0))
    section = Sizes(5.9 - 1e-3, np.pi / 4.0, 5.9, 6.0).drawn((plate(5.9 - 1e-3, ((-1e-3, 1e-3),)), strip))
    with pytest.raises(InputError, match="face_behind_share"):
        judged_plan(simulate(3, True, section))


def test_noise_that_neighbouring_columns_share_makes_no_corner() -> None:
    rng, place = np.random.default_rng(1), (np.arange(12) + 0.5) / 12.0
    smooth = np.exp(-np.abs(np.subtract.outer(np.arange(12.0), np.arange(12.0))) / 3.0)
    for _ in range(200):
        noise = rng.normal(0.0, 0.012, (120, 12)) @ np.linalg.cholesky(smooth).T
        assert _shape(place, noise, 1.2).turn == 0.0
    bent = noise + np.maximum(place - 0.6, 0.0) * 1.2 * np.tan(6.0 * DEG)
    assert _shape(place, bent, 1.2).turn == pytest.approx(6.0 * DEG, rel=0.2)
