"""The planned path against the truth of the part: planes, axes, spacing, clamps, refusals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.path.conftest import Raw
from tests.report.test_sensitivity import ROBOT, TABLE, TOOL
from workbench.api import rotation_from_quaternion
from workbench.artefacts import Layer, MeasuredAxis, Part, RawEdge, Toolpath, Travel
from workbench.errors import InputError
from workbench.path import check, feed, layers
from workbench.units import DEG, Float

CURVES = {
    "straight": {"shape": "straight"},
    "convex": {"shape": "arc", "radius_mm": 300, "sense": "convex"},
    "concave": {"shape": "arc", "radius_mm": 300, "sense": "concave"},
    "wavy": {"shape": "wavy", "amplitude_mm": 3, "wavelength_mm": 150},
}
STREAM = {"passes": [{"from_mm": 2.0, "to_mm": 62.0, "motion": "stream", "follow": "edge"}]}
CLAMPED = {
    "part": {"length_mm": 124.0, "clamps": [{"from_mm": 50, "to_mm": 66, "height_mm": 12}], "table_gap_mm": 3},
    "passes": [{"from_mm": 2.0, "to_mm": 122.0}],
}


def curved(raw: Callable[..., Raw], name: str) -> Raw:
    return raw(part={"curve": CURVES[name]}, **(STREAM if name != "straight" else {}))


def section_at(scan: Raw, s: Float) -> tuple[Float, Float, Float, Float]:
    """Lower edge, t, n, m of the truth at arc lengths s of the measured edge."""
    truth, at = scan.truth, s + scan.start_mm
    rows = [
        np.stack([np.interp(at, truth.arc_length_mm, v[:, k]) for k in range(3)], axis=1)
        for v in (truth.position_mm, truth.tangent, truth.normal, truth.across)
    ]
    return rows[0], rows[1], rows[2], rows[3]


def heights(scan: Raw, layer: Layer, s: Float) -> Float:
    """Of a layer's points above the true bevel, at arc lengths s."""
    p, _, n, m = section_at(scan, s)
    b = n * math.cos(40 * DEG) + m * math.sin(40 * DEG)
    return ((layer.position_mm - p - 1.5 * m) * b).sum(axis=1)


@pytest.mark.parametrize("name", CURVES)
def test_layers_lie_on_planes_of_the_true_bevel(raw: Callable[..., Raw], name: str) -> None:
    scan = curved(raw, name)
    path = layers(scan.edge, scan.cloud)
    assert [layer.height_mm for layer in path.layers] == [4.0, 3.0, 2.0, 1.0, 0.0]  # 8 mm thick: 4.18 mm of stock
    assert [layer.index for layer in path.layers] == [1, 2, 3, 4, 5]
    assert (path.rests_on, path.refused) == ("", ())
    for layer in path.layers:
        cut = layer.cutting
        p, t, n, m = section_at(scan, layer.arc_length_mm[cut])
        b = n * math.cos(40 * DEG) + m * math.sin(40 * DEG)
        height = ((layer.position_mm[cut] - p - 1.5 * m) * b).sum(axis=1)
        np.testing.assert_allclose(height, layer.height_mm, atol=0.002)
        np.testing.assert_allclose(((layer.position_mm[cut] - p) * t).sum(axis=1), 0, atol=0.01)
        axes = rotation_from_quaternion(layer.quaternion_wxyz[cut])
        down = n * math.sin(40 * DEG) - m * math.cos(40 * DEG)
        for column, expected in ((0, -b), (1, t), (2, down)):
            angle = np.linalg.norm(np.cross(axes[:, :, column], expected), axis=1)
            assert angle.max() < 0.02 * DEG
            assert ((axes[:, :, column] * expected).sum(axis=1) > 0).all()
        assert (np.sum(layer.quaternion_wxyz[1:] * layer.quaternion_wxyz[:-1], axis=1) > 0.99).all()


@pytest.mark.parametrize("name", ["straight", "wavy"])
def test_origins_are_midway_on_the_face_and_it_is_as_wide_as_the_plate_says(raw: Callable[..., Raw], name: str) -> None:
    scan = curved(raw, name)
    for layer in layers(scan.edge, scan.cloud).layers:
        p, _, n, m = section_at(scan, layer.arc_length_mm)
        low = 1.5 + layer.height_mm / math.sin(40 * DEG)  # up the end face
        middle = p + m * (low + 8) / 2 - n * (8 - low) / 2 * math.tan(40 * DEG)
        cut = layer.cutting
        np.testing.assert_allclose(layer.position_mm[cut], middle[cut], atol=0.01)
        np.testing.assert_allclose(layer.width_mm[cut], (8 - low) / math.cos(40 * DEG), atol=0.01)
        assert (layer.width_mm[~cut] == 0).all()


def test_thin_stretches_are_not_cut_by_the_upper_layers(raw: Callable[..., Raw]) -> None:
    scan = raw(part={"thickness_mm": {"start": 6, "end": 9}})
    path = layers(scan.edge, scan.cloud)
    for layer in path.layers:
        s = layer.arc_length_mm[layer.cutting]
        thick = np.interp(s + scan.start_mm, scan.truth.arc_length_mm, scan.truth.thickness_mm)
        assert ((thick - 1.5) * math.sin(40 * DEG) > layer.height_mm).all()
        assert s.size > 0
    assert path.layers[0].cutting.sum() < 0.5 * path.layers[-1].cutting.sum()


def test_leads_come_down_smoothly_from_above_the_stock(raw: Callable[..., Raw]) -> None:
    scan = curved(raw, "convex")
    path = layers(scan.edge, scan.cloud, clearance_mm=4)
    for layer in path.layers:
        height = heights(scan, layer, np.clip(layer.arc_length_mm, 0, path.edge_length_mm))
        before, after = layer.arc_length_mm < 0, layer.arc_length_mm > path.edge_length_mm
        assert not layer.cutting[before | after].any()
        np.testing.assert_allclose(height[[0, -1]], (8 - 1.5) * math.sin(40 * DEG) + 4, atol=0.05)
        assert (np.diff(height[before]) < 0).all()
        assert (np.diff(height[after]) > 0).all()
        assert abs(height[before][-1] - layer.height_mm) < 0.3  # tangential
        assert np.abs(np.diff(height, 2)).max() < 0.6  # no corner


def inside_cutter(path: Toolpath, points: Layer | Travel, obstacle: Float) -> Float:
    """For each point of a move the least distance of an obstacle's points from the axis, beside the cutter alone."""
    axes, out = rotation_from_quaternion(points.quaternion_wxyz), np.full(len(points.position_mm), np.inf)
    for k, (origin, axis) in enumerate(zip(points.position_mm, axes, strict=True)):
        off = (obstacle - origin) @ axis
        beside = off[:, 2] < path.cutter.flute_length_mm / 2
        radial = np.hypot(off[:, 0] + path.cutter.diameter_mm / 2, off[:, 1])
        out[k] = radial[beside].min(initial=np.inf)
    return out


def clamp_points(scan: Raw) -> Float:
    """The true clamp's box, sampled every mm."""
    truth, clamp = scan.truth, scan.truth.recipe.part.clamps[0]
    mid = int(np.argmin(np.abs(truth.arc_length_mm - (clamp.from_mm + clamp.to_mm) / 2)))
    p, t, n, m = (v[mid] for v in (truth.position_mm, truth.tangent, truth.normal, truth.across))
    half = (clamp.to_mm - clamp.from_mm) / 2
    along, out, up = np.arange(-half, half + 0.5), np.arange(-20, clamp.reach_out_mm + 0.5), np.arange(-2, 8 + 12.5)
    grid = np.stack(np.meshgrid(along, out, up, indexing="ij"), axis=-1).reshape(-1, 3)
    return p + grid @ np.stack([t, n, m])


def test_cutter_passes_above_clamps_and_what_they_hide(raw: Callable[..., Raw]) -> None:
    scan = raw(**CLAMPED)
    path = layers(scan.edge, scan.cloud)
    box = clamp_points(scan)
    for points in (*path.layers, *path.travels):
        assert inside_cutter(path, points, box).min() > 5.0 + 1.5
    assert len(path.refused) == 1
    assert "clamp" in path.refused[0]
    final = path.layers[-1]
    hidden = (final.arc_length_mm > 48) & (final.arc_length_mm < 64)
    assert not final.measured[hidden].any()
    lost = final.arc_length_mm[~final.cutting & (final.arc_length_mm >= 0) & (final.arc_length_mm <= 120)]
    assert lost.min() > 48 - 13
    assert lost.max() < 64 + 13
    assert not any((layer.cutting & ~layer.measured).any() for layer in path.layers)


def test_a_gap_without_a_clamp_is_passed_in_the_air(raw: Callable[..., Raw]) -> None:
    scan = raw()
    seen = scan.edge.seen.copy()
    seen[20:45] = False
    position = np.where(seen[:, None], scan.edge.position_mm, np.nan)
    path = layers(replace(scan.edge, seen=seen, position_mm=position), scan.cloud)
    final = path.layers[-1]
    np.testing.assert_array_equal(final.cutting, final.measured & (np.abs(final.arc_length_mm - 30) <= 30))
    assert path.refused == ("arc length 20.0 to 44.0 mm: not measured",)
    above = (final.arc_length_mm > 25) & (final.arc_length_mm < 39)
    height = heights(scan, final, final.arc_length_mm)
    assert (height[above] > 9).all()
    for layer in path.layers:  # whichever layer it comes from, the cutter passes at one height
        np.testing.assert_allclose(heights(scan, layer, layer.arc_length_mm)[above], height[above], atol=1e-6)


@pytest.mark.parametrize("lost", [slice(0, 6), slice(55, None)])
def test_an_end_that_is_not_known_is_passed_in_the_air(raw: Callable[..., Raw], lost: slice) -> None:
    """Before the first known place the cutter ran at its final height through stock that no scan had told of."""
    scan = raw()
    u = scan.edge.position_u_mm.copy()
    u[lost] = 2.0
    edge = replace(scan.edge, position_u_mm=u)
    path = layers(edge, scan.cloud)
    final = path.layers[-1]
    height = heights(scan, final, final.arc_length_mm)
    there = scan.edge.arc_length_mm[lost]
    middle = np.abs(final.arc_length_mm - there[len(there) // 2]) < 1.0
    assert (height[middle] > 1.0).all()
    assert not final.cutting[(final.arc_length_mm >= there[0]) & (final.arc_length_mm <= there[-1])].any()
    assert check(feed(path, scan.cloud, edge), edge, scan.cloud).passed
    assert "not measured" in path.refused[0]


def rounded_edge(radius_mm: float) -> RawEdge:
    """A concave quarter of a circle by formula, 8 mm thick: the air lies within the circle."""
    s = np.linspace(0, radius_mm * math.pi / 2, round(radius_mm * math.pi / 2) + 1)
    angle = -s / radius_mm
    zero = 0 * angle
    inwards = np.stack([-np.cos(angle), -np.sin(angle), zero], axis=1)  # n: to the centre, where the air is
    up = np.tile([0.0, 0.0, 1.0], (s.size, 1))
    position = -radius_mm * inwards + [1000.0, 0, 500]
    return RawEdge(
        faces={},
        labels=np.zeros((1, 1), np.uint8),
        pass_index=np.zeros(1, np.int64),
        frame_arc_length_mm=np.zeros(1),
        tangent_u=0.0 * s,
        arc_length_mm=s,
        position_mm=position,
        tangent=np.cross(up, inwards),
        normal=inwards,
        across=up,
        seen=np.ones(s.size, bool),
        burr_stations=np.empty(0, np.int64),
        upper_position_mm=position + 8 * up,
        upper_inward=-inwards,
        position_u_mm=np.zeros((s.size, 2)),
        normal_u=0.0 * s,
    )


def test_a_concave_edge_tighter_than_the_cutter_is_refused_with_its_place(raw: Callable[..., Raw]) -> None:
    cloud = replace(
        raw().cloud,
        keep=np.zeros((1, 1), bool),
        x_mm=np.zeros((1, 1), np.float32),
        z_mm=np.zeros((1, 1), np.float32),
        base_from_profiler=np.eye(4)[None],
        pass_index=np.zeros(1, np.int64),
        time_s=np.zeros(1),
    )
    with pytest.raises(InputError, match=r"arc length .* mm: concave with a radius of 12\.0 mm"):
        layers(rounded_edge(12), cloud, cutter_diameter_mm=20)
    assert len(layers(rounded_edge(60), cloud, cutter_diameter_mm=20).layers) == 5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"root_mm": 8.5}, "root_mm.*8.5 mm.*8.00 mm thick at arc length"),
        ({"root_mm": 7.95}, "nothing to cut"),
        ({"depth_of_cut_mm": 6.0}, "depth_of_cut_mm.*radius of 5 mm"),
        ({"flute_length_mm": 7.0}, "flute_length_mm.*8.49 mm wide"),
        ({"bevel_deg": 80.0}, "bevel_deg"),
        ({"root_mm": -1.0}, "root_mm"),
    ],
)
def test_requirements_that_cannot_be_satisfied(raw: Callable[..., Raw], options: dict[str, float], words: str) -> None:
    scan = raw()
    with pytest.raises(Exception, match=words) as refused:
        layers(scan.edge, scan.cloud, **options)  # type: ignore[arg-type]
    assert "\n" not in str(refused.value)


def test_edges_that_cannot_be_planned_for(raw: Callable[..., Raw]) -> None:
    scan = raw()
    edge = scan.edge
    seen = np.arange(len(edge.seen)) < 0.4 * len(edge.seen)
    with pytest.raises(InputError, match=r"seen on 39 % of its length|seen on 41 % of its length"):
        layers(replace(edge, seen=seen), scan.cloud)
    unknown = np.full_like(edge.position_mm, np.nan)
    with pytest.raises(InputError, match="upper edge was seen nowhere"):
        layers(replace(edge, upper_position_mm=unknown), scan.cloud)
    once = np.where(np.arange(len(seen))[:, None] == len(seen) // 2, edge.upper_position_mm, np.nan)
    with pytest.raises(InputError, match="upper edge was seen at 1 of"):
        layers(replace(edge, upper_position_mm=once), scan.cloud)


def test_what_is_not_known_well_enough_is_not_cut(raw) -> None:
    """Where the edge's own uncertainty is beyond the tolerance the cutter is lifted; a stretch of it is told."""
    scan = raw()
    at = scan.edge.arc_length_mm
    for name, much in (("normal_u", np.radians(0.7)), ("tangent_u", np.radians(11.0))):
        unknown = np.where((at > 25) & (at < 40), much, 0.0)
        path = layers(replace(scan.edge, **{name: unknown}), scan.cloud)
        final = path.layers[-1]
        inside = (final.arc_length_mm > 25.5) & (final.arc_length_mm < 39.5)
        assert not final.cutting[inside].any()
        assert final.cutting[(final.arc_length_mm > 3) & (final.arc_length_mm < 18)].all()
        assert any("does not determine the edge well enough" in told for told in path.warnings)
        assert (
            layers(replace(scan.edge, **{name: unknown}), scan.cloud, bevel_tolerance_deg=29)
            .layers[-1]
            .cutting[inside]
            .all()
        )
    vague = replace(scan.edge, position_u_mm=np.tile([0.4, 0.02], (at.size, 1)))
    with pytest.raises(InputError, match=r"known well enough on 0 % of its length"):
        layers(vague, scan.cloud)


def test_tool_turntable_and_robot_count_in_what_the_place_is_known_to(raw, tmp_path) -> None:
    scan = raw()
    tool, table, robot = (tmp_path / name for name in ("tcp.json", "turntable.json", "robot.json"))
    tool.write_text(TOOL.model_dump_json())
    table.write_text(TABLE.model_dump_json())
    robot.write_text(ROBOT.model_copy(update={"u_mm": 0.12}).model_dump_json())
    assert layers(scan.edge, scan.cloud).chain is None
    path = layers(scan.edge, scan.cloud, tool=tool, turntable=table, robot_accuracy_mm=0.12)
    assert path.chain.place_mm == pytest.approx(0.13)
    assert path.chain.turn == pytest.approx(np.radians(np.hypot(0.02, 0.01)))
    assert path.chain.rests_on == ("tool", "turntable", "robot")
    assert path.chain.axes == {
        "tool": MeasuredAxis((0, 0, 250), (0, 0, 1), 0.03, 0.02),
        "turntable": MeasuredAxis((0, 0, 0), (0, 0, 1), 0.04, 0.01),
    }
    path = layers(scan.edge, scan.cloud, tool=tool, turntable=table, robot_calibration=robot, robot_accuracy_mm=0.5)
    assert path.chain.place_mm == pytest.approx(0.13)  # the file's 0.12 mm, not what was typed
    for name, file in (("tool", TOOL), ("turntable", TABLE), ("robot_calibration", ROBOT)):
        theirs = file.model_copy(update={"part": Part(robot_serial="R2")})
        (tmp_path / "other.json").write_text(theirs.model_dump_json())
        own = replace(scan.edge, part=replace(scan.edge.part, robot_serial="R1"))
        with pytest.raises(InputError, match="expected the recording's robot, 'R1', found 'R2'"):
            layers(own, scan.cloud, **{name: tmp_path / "other.json"})
    vague = TOOL.points[0].model_copy(update={"u_mm": 0.3})
    tool.write_text(TOOL.model_copy(update={"points": [vague], "axis": None}).model_dump_json())
    with pytest.raises(InputError, match=r"known well enough on 0 % .* with tool known to 0.3 mm and 0.05 deg"):
        layers(scan.edge, scan.cloud, tool=tool)
    first = layers(scan.edge, scan.cloud, tool=tool, finish_allowance_mm=0.5)  # a measured cut will show it
    assert first.chain is not None
    with pytest.raises(InputError, match="expected 'tool-calibration'"):
        layers(scan.edge, scan.cloud, tool=table)
