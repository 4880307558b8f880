"""What a path's checks let through, and what they must not: each fault is injected."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.path.conftest import Raw
from tests.program.paths import in_work_object
from workbench.api import pose_from, quaternion_from_rotation, rotation_from_quaternion, rotation_from_vector
from workbench.artefacts import Check, Edge, Layer, Toolpath
from workbench.path import check, layers
from workbench.units import DEG, Float

CLAMPED = {
    "part": {"length_mm": 94.0, "clamps": [{"from_mm": 40, "to_mm": 54, "height_mm": 12}]},
    "passes": [{"from_mm": 2.0, "to_mm": 92.0}],
}


def change(path: Toolpath, **columns: Callable[[Layer], Any]) -> Toolpath:
    """The path with columns of every layer replaced."""
    made = [replace(layer, **{name: make(layer) for name, make in columns.items()}) for layer in path.layers]
    return replace(path, layers=tuple(made))


def turned(layer: Layer, axis: int, angle_deg: float) -> Float:
    """Orientations turned about one of the tool's own axes."""
    vector = np.eye(3)[axis] * angle_deg * DEG
    turn = rotation_from_quaternion(layer.quaternion_wxyz) @ rotation_from_vector(vector)
    found = quaternion_from_rotation(turn)
    flips = np.sign((found[1:] * found[:-1]).sum(axis=1))
    return found * np.cumprod(np.concatenate([[1.0], flips]))[:, None]


@pytest.mark.parametrize(
    "changes",
    [
        {"passes": [{"from_mm": 2.0, "to_mm": 61.6}]},  # the last interval is shorter
        CLAMPED,
        {"part": {"roughness_mm": 0.2, "table_gap_mm": 3}},
        {
            "part": {"curve": {"shape": "arc", "radius_mm": 300, "sense": "concave"}},
            "passes": [{"from_mm": 2.0, "to_mm": 62.0, "motion": "stream", "follow": "edge"}],
        },
        {"part": {"thickness_mm": {"start": 6, "end": 9}}},
    ],
)
def test_a_sound_path_passes(raw: Callable[..., Raw], changes: dict[str, Any]) -> None:
    scan = raw(**changes)
    gate = check(scan.plan, scan.edge, scan.cloud)
    assert gate.passed, gate.reason


def test_a_path_in_the_work_objects_frame_passes(raw: Callable[..., Raw]) -> None:
    scan = raw()
    work = pose_from(rotation_from_vector(np.array([0.3, -1.0, 0.4])), np.array([900.0, 100, 700]))
    there = in_work_object(scan.plan, work)
    gate = check(there, scan.edge, scan.cloud)
    assert gate.passed, gate.reason
    assert not check(replace(there, base_from_workobject=None), scan.edge, scan.cloud).passed


def misread(edge: Edge, lower: str, upper: str, n: int) -> Edge:
    """The edge of someone who takes the lower side for the upper one (n 1), or the way into the plate for the way out.

    Two of its axes go the other way, along the edge too.
    """
    back = slice(None, None, -1)
    return replace(
        edge,
        position_mm=getattr(edge, lower)[back],
        upper_position_mm=getattr(edge, upper)[back],
        across=-n * edge.across[back],
        tangent=-edge.tangent[back],
        normal=n * edge.normal[back],
        seen=edge.seen[back],
        upper_inward=-n * edge.normal[back],
        frame_arc_length_mm=edge.arc_length_mm[-1] - edge.frame_arc_length_mm,
    )


MIRRORED, INVERTED = ("upper_position_mm", "position_mm", 1), ("position_mm", "upper_position_mm", -1)


def tilted(axis: int, angle_deg: float) -> Callable[[Toolpath], Toolpath]:
    return lambda path: change(path, quaternion_wxyz=lambda layer: turned(layer, axis, angle_deg))


def fed(feed: Callable[[Layer], Any]) -> Callable[[Toolpath], Toolpath]:
    return lambda path: change(path, feed_mm_s=feed)


FAULTS: dict[str, tuple[Callable[[Toolpath], Toolpath], str]] = {
    "tilt about z, as the paper prints it": (tilted(2, 40), "does not move along the edge"),
    "tilt about x": (tilted(0, 40), "does not move along the edge"),
    "tip and shank exchanged": (tilted(1, 180), "axis out of the bevel face"),
    "out of the material": (tilted(2, 180), "does not face the material"),
    "a tenth of a degree": (tilted(1, 0.1), "axis out of the bevel face"),
    "below the finished bevel": (
        lambda p: replace(p, layers=(*p.layers[:-1], lowered(p.layers[-1]))),
        "layer 5 lies below the finished bevel",
    ),
    "final layer missing": (lambda p: replace(p, layers=p.layers[:-1], travels=p.travels[:-1]), "not the final one"),
    "layers in another order": (
        lambda p: replace(p, layers=(p.layers[1], p.layers[0], *p.layers[2:])),
        "cutting order",
    ),
    "a layer left out": (
        lambda p: replace(p, layers=(p.layers[0], *p.layers[2:]), travels=p.travels[:-1]),
        "deeper than the depth",
    ),
    "a layer in the air": (
        lambda p: replace(p, layers=(in_the_air(p.layers[0]), *p.layers[1:])),
        "layer 1 cuts nothing but air",
    ),
    "a key point left out": (lambda p: change(p, **without(20)), "no point every mm"),
    "the last key point but one left out": (lambda p: change(p, **without(last_key(p) - 1)), "no point every mm"),
    "the end left out": (lambda p: change(p, **without(slice(-14, None))), "from one end of the edge to the other"),
    "cutting what was not measured": (
        lambda p: change(p, measured=lambda q: q.measured & (q.arc_length_mm != 30)),
        "nothing was measured",
    ),
    "too fast": (fed(lambda q: 30 * q.feed_mm_s), "expected 1 to 20"),
    "too fast in the material": (fed(lambda q: q.feed_mm_s + 0.01), "cuts faster than 1 mm/s"),
    "a jump of the feed": (fed(lambda q: np.where(q.arc_length_mm < -8, 20, q.feed_mm_s)), "changes by more"),
    "a quaternion's sign": (
        lambda p: change(p, quaternion_wxyz=lambda q: q.quaternion_wxyz * np.sign(q.arc_length_mm[:, None] - 9.5)),
        "continuous in sign",
    ),
    "back and forth": (
        lambda p: change(p, position_mm=lambda q: swapped(q.position_mm, 25)),
        "crosses itself|not in the section",
    ),
}


def lowered(layer: Layer) -> Layer:
    inwards = rotation_from_quaternion(layer.quaternion_wxyz)[:, :, 0]
    return replace(layer, position_mm=layer.position_mm + 0.01 * inwards)


def in_the_air(layer: Layer) -> Layer:
    return replace(layer, cutting=np.zeros_like(layer.cutting), width_mm=np.zeros_like(layer.width_mm))


def without(rows: Any) -> dict[str, Callable[[Layer], Any]]:
    """Every column of a layer without some rows."""
    names = [f.name for f in dataclasses.fields(Layer) if f.name not in ("index", "height_mm")]
    return {name: (lambda layer, name=name: np.delete(getattr(layer, name), rows, axis=0)) for name in names}


def last_key(path: Toolpath) -> int:
    """Row of the point at the end of the edge, in every layer."""
    return int(np.flatnonzero(path.layers[0].arc_length_mm <= path.edge_length_mm + 1e-6)[-1])


def swapped(values: Float, row: int) -> Float:
    out = values.copy()
    out[[row, row + 1]] = out[[row + 1, row]]
    return out


@pytest.mark.parametrize("name", FAULTS)
def test_an_injected_fault_is_found(raw: Callable[..., Raw], name: str) -> None:
    scan, (inject, words) = raw(), FAULTS[name]
    gate = check(inject(scan.plan), scan.edge, scan.cloud, v_fast_mm_s=20)
    assert not gate.passed
    assert gate.reason.startswith("path refused: ")
    assert any(word in gate.reason for word in words.split("|")), gate.reason


@pytest.mark.parametrize("wrong", [MIRRORED, INVERTED])
def test_a_path_for_the_wrong_side_is_found(raw: Callable[..., Raw], wrong: tuple[str, str, int]) -> None:
    scan = raw(scanner={"columns": 400})
    nothing = replace(scan.cloud, keep=np.zeros_like(scan.cloud.keep))  # so that no obstacle stops the wrong plan
    path = layers(misread(scan.edge, *wrong), nothing)
    assert not check(path, scan.edge, scan.cloud).passed


def test_a_wrong_edge_is_found_by_the_cloud_alone(raw: Callable[..., Raw]) -> None:
    """Path and edge agree on the wrong way out: the cutter would go through the plate."""
    scan = raw(scanner={"columns": 400})
    wrong = misread(scan.edge, *INVERTED)
    path = layers(wrong, replace(scan.cloud, keep=np.zeros_like(scan.cloud.keep)))
    gate = check(path, wrong, scan.cloud)
    assert not gate.passed
    assert "the cutter enters" in gate.reason


def test_a_clamp_that_the_plan_did_not_know_is_found(raw: Callable[..., Raw]) -> None:
    scan = raw(**CLAMPED)
    blind = replace(
        scan.edge,
        seen=np.ones_like(scan.edge.seen),
        position_mm=filled(scan.edge.position_mm),
        upper_position_mm=filled(scan.edge.upper_position_mm),
    )
    nothing = replace(scan.cloud, keep=np.zeros_like(scan.cloud.keep))
    gate = check(layers(blind, nothing), blind, scan.cloud)
    assert not gate.passed
    assert "the cutter enters what must remain by" in gate.reason


def filled(values: Float | None) -> Float:
    at, good = np.arange(len(values)), np.isfinite(values[:, 0])
    return np.stack([np.interp(at, at[good], values[good, k]) for k in range(3)], axis=1)


def test_a_travel_through_the_plate_is_found(raw: Callable[..., Raw]) -> None:
    scan = raw()
    path = scan.plan
    low = replace(path.travels[1], position_mm=path.travels[1].position_mm - 13 * bevel_normal_of(scan))
    gate = check(
        replace(path, travels=(path.travels[0], low, *path.travels[2:])), scan.edge, scan.cloud, acceleration_mm_s2=1e5
    )
    assert not gate.passed
    assert "in a travel move" in gate.reason


def bevel_normal_of(scan: Raw) -> Float:
    return math.cos(40 * DEG) * scan.edge.normal[0] + math.sin(40 * DEG) * scan.edge.across[0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("flange_turn_deg", "a scale of its travel would not show"),
        ("order_share", "too few profiles agree, which does not show their order"),
        ("pass_disagreement_mm", "the recording does not show how far apart these lie"),
        ("pass_disagreement_mm", "nothing tells how far apart these lie"),  # of earlier files
        ("late_turn_deg", "the orientation is the same to the last digit: its rotation is in no value"),
    ],
)
def test_what_a_recording_does_not_show_is_named(name: str, words: str, raw: Callable[..., Raw]) -> None:
    scan = raw()
    blind = Check(name, None, None, True, "", words)
    told = replace(blind, value=1.0, finding="two passes see one face 0.01 mm apart")
    toolpath = replace(scan.plan, evidence=(blind,))
    assert blind.finding in check(toolpath, scan.edge, scan.cloud).unchecked
    assert told.finding not in check(replace(toolpath, evidence=(told,)), scan.edge, scan.cloud).unchecked
