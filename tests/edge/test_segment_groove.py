"""Grooves of the simulators are found, with their type and sizes; what is no groove is refused."""

import contextlib
import dataclasses
import math
from functools import cache, partial

import numpy as np
import pytest

from bench.confidently_wrong.kinds import KINDS
from bench.drawn.grooves import random_groove_recipe, random_prism_recipe
from bench.joints import JOINTS, groove_sizes, measured
from bench.joints import errors as errors_of
from bench.score import triangulated
from bench.simulators.swept import simulate_groove
from bench.simulators.swept.recipe import GrooveRecipe
from tests.seldom import seldom
from workbench.artefacts import TANGENT, Cloud, Groove, Recording
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.errors import InputError
from workbench.inspect import groove as inspect_groove
from workbench.scan import fuse
from workbench.synthetic import GrooveTruth, parse_recipe, simulate_prism, simulate_recording

SEED = 4711


def short(recipe):
    """The first 40 mm of its pass."""
    (one,) = recipe.passes
    if isinstance(recipe, GrooveRecipe):
        first, last = one.way_mm
        way = {"way_mm": (first, first + math.copysign(40.0, last - first))}
    else:
        way = {"to_mm": one.from_mm + math.copysign(40.0, one.to_mm - one.from_mm)}
    return recipe.model_copy(update={"passes": (one.model_copy(update=way),)})


def errors(inspection, truth):
    return errors_of(inspection, partial(groove_sizes, truth))


@cache
def scanned(kind: str) -> tuple[Cloud, GrooveTruth]:
    recording, truth = simulate_groove(short(random_groove_recipe(kind, SEED)))
    return denoise(fuse(recording)), truth


def found(kind: str, **given: object) -> tuple[Groove, GrooveTruth]:
    cloud, truth = scanned(kind)
    return segment_groove(cloud, **given), truth


@pytest.mark.parametrize("kind", ["V", "HY", "U", *seldom("I", "J")])
def test_type_and_sizes_come_back(kind: str) -> None:
    groove, truth = found(kind, **({"groove": "I"} if kind == "I" else {}))  # what is square below, no view shows
    assert kind in (groove.type, *groove.alternatives)
    rows = errors(inspect_groove(groove), truth)
    assert {"gap_mm", "width_mm", "misalignment_mm"} <= {size for size, _, _ in rows}
    z = np.array([abs(error) / u for _, error, u in rows])
    assert np.median(z) < 1.5  # the values of one part hang together: its share within 2 u tells little
    assert z.max() < 4.0


def test_ends_beside_blind_columns_are_known_to_their_width() -> None:
    """A dirty window: bands of 8 columns that never measure. The depth was 0.4 mm off at 25 u."""
    recording, truth = simulate_prism(short(random_prism_recipe("V", 5_540_000)))
    dirty = KINDS["12 bands of 8 blind columns"].spoil(recording, np.random.default_rng([5_540_000, 0]))
    rows = errors(inspect_groove(segment_groove(denoise(fuse(dirty)))), truth)
    assert {"depth_mm", "gap_mm"} <= {size for size, _, _ in rows}
    assert max(abs(error) / u for _, error, u in rows) < 3.0


@pytest.mark.parametrize("way", [1, *seldom(-1)])
def test_columns_that_are_dark_where_a_root_passes_do_not_end_it(way: int) -> None:
    """Ten of them, merged with the gap's dark, moved the gap by 0.27 mm, 19 u: what they end is left out, and said."""
    recipe = short(random_prism_recipe("V", 12_700_100))
    aside = recipe.passes[0].model_copy(update={"skew_mm": (-0.4, 0.4)})  # across the view, by less than the gap
    recording, truth = simulate_prism(recipe.model_copy(update={"passes": (aside,)}))
    z_mm = recording.z_mm.copy()[:, ::way]
    share = np.isfinite(z_mm).mean(axis=0)
    gap = 200 + int(share[200:-200].argmin())
    z_mm[:, 1 + np.flatnonzero(share[:gap] > 0.35).max() : gap] = np.nan
    z_mm = np.ascontiguousarray(z_mm[:, ::way])
    groove = segment_groove(denoise(fuse(dataclasses.replace(recording, z_mm=z_mm))))
    assert sum("over which it moves" in told for told in groove.warnings) == 1
    rows = errors(inspect_groove(groove), truth)
    assert "gap_mm" in {size for size, _, _ in rows}
    assert max(abs(error) / u for _, error, u in rows) < 3.0


def test_a_pass_near_a_limit_rests_on_the_knife_edges() -> None:
    """Rounded by 0.15 mm, which no return shows, those of a V moved its gap by 0.22 mm, 11 u: it passed."""
    cloud = denoise(fuse(simulate_prism(random_prism_recipe("V", 12_700_100))[0]))
    groove, sharp = (segment_groove(cloud, groove="V", edge_condition=one) for one in ("unknown", "sharp"))
    least = round(float(np.nanmin(groove.sizes["gap_mm"].value)), 3)
    near, far = ({"gap_mm": least, "gap_tolerance_mm": [-off_mm, 5.0]} for off_mm in (0.1, 0.3))
    for found_, required, names in ((groove, near, ["knife_edge"]), (groove, far, []), (sharp, near, [])):
        judged = inspect_groove(found_, nominal=required)
        assert (judged.verdict, [one.name for one in judged.conditions]) == ("undecided" if names else "pass", names)
    assert inspect_groove(groove, nominal=near, accept_conditions=("knife_edge",)).verdict == "pass"


def test_a_profile_that_is_too_coarse_for_a_type_is_refused() -> None:
    """Every eighth column of a U groove was an HV of 16 deg less included angle, at u 0.014."""
    recording, _ = simulate_prism(random_prism_recipe("U", 5_540_004))
    coarse = KINDS["every 8th column delivered"].spoil(recording, np.random.default_rng(0))
    with pytest.raises(InputError, match=r"expected 150 returns and more in a profile, found \d+: .* every column"):
        segment_groove(denoise(fuse(coarse)))


def test_a_pass_that_shows_one_plate_alone_is_named() -> None:
    cloud, _ = scanned("V")
    count, columns = cloud.keep.shape
    second = np.arange(count) >= count // 2
    left = cloud.keep & ~(second[:, None] & (np.arange(columns) > columns // 2))
    found = segment_groove(dataclasses.replace(cloud, keep=left, pass_index=second.astype(cloud.pass_index.dtype)))
    assert any(one.startswith("pass 2 of 2 left out") for one in found.warnings)
    assert not any("left out" in one for one in segment_groove(cloud).warnings)


def test_a_wrong_type_is_refused() -> None:
    with pytest.raises(InputError, match=r"groove 'U'.*shows a bevel.*expected V"):
        found("V", groove="U")


def test_a_declared_type_that_is_not_excluded_is_taken() -> None:
    groove, _ = found("V", groove="Y")
    assert groove.type == "Y"
    assert groove.declared
    assert "V" in groove.alternatives or "X" in groove.alternatives


@pytest.mark.parametrize("kind", ["milled", "raw"])
def test_a_plates_edge_is_no_groove(kind: str) -> None:
    recipe = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": 5,
        "part": {"kind": kind, "length_mm": 50.0},
        "passes": [{"from_mm": 5.0, "to_mm": 45.0}],
    }
    recording, _ = simulate_recording(parse_recipe(recipe))
    with pytest.raises(InputError, match="groove"):
        segment_groove(denoise(fuse(recording)))


def changed(
    kind: str,
    part: dict[str, object],
    lean_deg: float = 0.0,
    robot: dict[str, object] | None = None,
    *,
    is_followed: bool = False,
) -> tuple[Recording, GrooveTruth]:
    """A random groove, straight, with another part and robot; the view leans over the left plate.

    is_followed: to a column, and single returns are lost.
    """
    recipe = random_groove_recipe(kind, SEED).model_dump(mode="json")
    recipe["part"] |= {"spine": {"length_mm": 60.0}, "upper_radius_mm": 0.0, **part}
    recipe["scanner"] |= {"columns": 640, "pitch_mm": 0.06, "apex_mm": None, "near_mm": 50.0, "far_mm": 400.0}
    recipe["passes"][0] |= {
        "way_mm": [2.0, 58.0],
        "elevation_deg": 90.0 + lean_deg,
        "oblique_deg": 0.0,
        "lead_deg": 3.0,
        "aim_mm": [0.0, 8.0],
        "follow": "line",
    }
    recipe["robot"] |= robot or {}
    if is_followed:
        recipe["passes"][0]["skew_mm"] = [0.0, 0.0]
        recipe["robot"] |= {"pose_noise_mm": 0.0, "pose_noise_deg": 0.0}
        recipe["losses"] |= {"block_share": 0.0, "outlier_share": 0.0}
    return simulate_groove(GrooveRecipe.model_validate(recipe))


def flat(value: float) -> dict[str, float]:
    return {"start": value, "end": value}


def test_a_root_in_the_other_plates_shadow_is_not_told() -> None:
    part = {
        "thickness_mm": flat(12.0),
        "gap_mm": flat(0.0),
        "misalignment_mm": flat(2.5),
        "root_face_left_mm": flat(3.0),
        "root_face_right_mm": flat(3.0),
        "bevel_left_deg": flat(30.0),
        "bevel_right_deg": flat(30.0),
    }
    recording, truth = changed("Y", part)
    groove = segment_groove(denoise(fuse(recording)))
    assert np.isnan(groove.sizes["gap_mm"].value).all()
    assert np.isnan(groove.sizes["depth_mm"].value).all()
    assert any("shadow" in warning for warning in groove.warnings)
    z = [abs(error) / u for _, error, u in errors(inspect_groove(groove), truth)]
    assert max(z) < 4.0


def test_a_bevel_that_the_view_may_hide_is_in_u() -> None:
    part = {"thickness_mm": flat(8.0), "gap_mm": flat(2.0), "background_mm": 10.0, "misalignment_mm": flat(0.0)}
    recording, _ = changed("I", part, lean_deg=18.0)
    cloud = denoise(fuse(recording))
    seen, said = segment_groove(cloud), segment_groove(cloud, groove="I")
    assert {"HV", "HY"} <= set(seen.alternatives)
    assert np.nanmedian(seen.sizes["gap_mm"].u) > 0.5
    assert np.nanmedian(said.sizes["gap_mm"].u) < 0.2
    with pytest.raises(InputError, match="groove 'HV'"):  # of that bevel nothing is measured
        segment_groove(cloud, groove="HV")


def test_a_type_of_which_the_view_hides_a_bevel_is_named_beside_a_root_face() -> None:
    """It was read as HY or K alone, and Y was refused for the sake of the bevel that the view hides."""
    part = {"thickness_mm": flat(12.0), "gap_mm": flat(2.0), "misalignment_mm": flat(0.0)}
    part |= {f"bevel_{side}_deg": flat(30.0) for side in ("left", "right")}
    part |= {f"root_face_{side}_mm": flat(1.5) for side in ("left", "right")}
    recording, truth = changed("Y", part, lean_deg=32.0)
    cloud = denoise(fuse(recording))
    groove = segment_groove(cloud)
    assert {"Y", "X"} <= {groove.type, *groove.alternatives}
    assert max(abs(error) / u for _, error, u in errors(inspect_groove(groove), truth)) < 3.5
    with pytest.raises(InputError, match="Y or X needs a scan, or a further pass"):
        segment_groove(cloud, groove="Y")


def test_plates_whose_ends_stay_in_their_columns_are_measured_where_a_groove_is_declared() -> None:
    """They were refused as dirt on the window; a stretch where an end lies in the next column was left out."""
    part = {"thickness_mm": flat(8.0), "gap_mm": flat(2.0), "misalignment_mm": flat(0.0), "background_mm": 300.0}
    recording, truth = changed("I", part, is_followed=True)
    cloud = denoise(fuse(recording))
    with pytest.raises(InputError, match="dirt on the window"):
        segment_groove(cloud)
    groove = segment_groove(cloud, groove="I")
    assert np.isfinite(groove.sizes["gap_mm"].value).all()
    assert [one.name for one in groove.unseen] == ["window_end"]
    assert max(abs(error) / u for _, error, u in errors(inspect_groove(groove), truth)) < 3.0


def test_the_flange_is_above_plates_with_nothing_seen_between_them() -> None:
    """Spatter on one of them once turned them upside down; their flange is on the scanner's side."""
    joint = JOINTS["prism"][1]("I", 5710007)
    inspection, rows = measured(joint)
    assert max(abs(error) / u for _, error, u in rows) < 3.0
    cloud = fuse(joint.recording)
    flange = cloud.base_from_profiler @ np.linalg.inv(cloud.flange_from_profiler)
    section = inspection.sections[4]
    assert ((flange[:, :3, 3] - section.origin_mm) @ section.across > 0.0).all()
    flange_from_profiler = np.eye(4)
    flange_from_profiler[2, 3] = -np.nanmedian(cloud.z_mm)
    level = dataclasses.replace(cloud, flange_from_profiler=flange_from_profiler)
    with pytest.raises(InputError, match="no flange above them tells which side is up"):
        segment_groove(denoise(level))


@pytest.mark.parametrize(
    ("kind", "part"),
    [
        ("K", {"gap_mm": flat(0.0)}),  # the last returns of a square face were the other plate's
        ("J", {"root_radius_mm": 0.6}),  # a small fillet below a flank is no bevel
        *seldom(("U", {"root_radius_mm": 0.6, "misalignment_mm": flat(2.0)}), ("K", {"misalignment_mm": flat(-2.0)})),
    ],
)
def test_a_groove_is_within_its_uncertainty_or_refused(kind: str, part: dict[str, object]) -> None:
    with contextlib.suppress(InputError):
        recording, truth = changed(kind, part)
        rows = errors(inspect_groove(segment_groove(denoise(fuse(recording)))), truth)
        assert max(abs(error) / u for _, error, u in rows) < 3.5


@pytest.mark.parametrize("sense", ["convex", *seldom("concave")])
def test_the_tangent_of_a_bowed_groove_counts_where_frames_cut_it_obliquely(sense: str) -> None:
    """They do at both ends, to either side: on average not at all."""
    bowed = {"spine": {"shape": "arc", "length_mm": 60.0, "radius_mm": 400.0, "sense": sense}}
    robot = {"smooth_error_mm": 0.06, "smooth_error_wavelength_mm": 40.0}
    recording, truth = changed("V", bowed, robot=robot)
    groove = segment_groove(denoise(fuse(recording)))
    for name in ("included_deg", "width_mm"):
        found = [(error, u) for size, error, u in errors(inspect_groove(groove), truth) if size == name]
        assert max(abs(error) / u for error, u in found) < 3.5
    by_tangent = groove.sizes["included_deg"].u_by_source[TANGENT]
    assert by_tangent[by_tangent.size // 2] < 0.3 * min(by_tangent[0], by_tangent[-1])


def test_last_returns_that_lie_low_are_no_proof_of_a_blunted_root() -> None:
    """By 4 um: a knife edge rounded by 0.05 mm, the most that is likely, was taken for certain."""
    part = triangulated.groove(18_800_005)
    recording, truth = part.recording, part.truth
    groove = segment_groove(denoise(fuse(recording)))
    nearest = np.linalg.norm(np.array(truth["position_mm"])[:, None] - groove.origin_mm, axis=2).argmin(axis=0)
    for name in ("gap_mm", "depth_mm"):
        size = groove.sizes[name]
        off = np.abs(size.value - np.array(truth[name])[nearest])[groove.seen]
        assert (off < 3.0 * size.u[groove.seen]).all(), name
