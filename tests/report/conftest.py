"""Milled edges of exact geometry, as the stages before the report hand them over."""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from dataclasses import dataclass
from html import unescape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import workbench.report
from tests.conftest import bevel_sizes
from workbench.artefacts import (
    BEVEL_FACE,
    ROOT_FACE,
    UNLABELLED,
    UPPER_SURFACE,
    Cloud,
    Cutter,
    EdgeProfile,
    Inspection,
    Layer,
    MilledEdge,
    Part,
    Provenance,
    RawEdge,
    Requirements,
    Section,
    Toolpath,
    Travel,
)
from workbench.plot import Figure
from workbench.units import DEG

THICKNESS_MM, ROOT_MM, BEVEL_DEG = 10.0, 1.5, 40.0
LENGTH_MM, VIEW = 200.0, 42 * DEG  # VIEW: from the outward normal up to the direction towards the sensor


@dataclass(frozen=True)
class Inspected:
    cloud: Cloud
    edge: MilledEdge
    inspection: Inspection


def root_at(s):
    return ROOT_MM + 0.08 * np.sin(2 * np.pi * s / 120)


def angle_deg_at(s):
    return BEVEL_DEG + 0.3 * np.cos(2 * np.pi * s / 160)


def edge_frames(s, radius_mm):
    """Lower edge P, tangent t, outward normal n, across m at arc lengths s: straight, or an arc seen from outside."""
    s = np.asarray(s, float)
    across = np.tile([0.0, 0.0, 1.0], (len(s), 1))
    if radius_mm is None:
        normal = np.tile([0.0, -1.0, 0.0], (len(s), 1))
        position = np.column_stack([s, np.zeros_like(s), np.zeros_like(s)])
    else:
        a = s / radius_mm
        normal = np.column_stack([np.sin(a), -np.cos(a), np.zeros_like(a)])
        position = radius_mm * normal
    return position + np.array([1200.0, -300.0, 800.0]), np.cross(across, normal), normal, across


def milled_outline(s):
    """Corners (u, v) of the section at arc length s, from the lower edge up and into the plate; faces between them."""
    root, beta = root_at(s), angle_deg_at(s) * DEG
    upper = np.array([-(THICKNESS_MM - root) * np.tan(beta), THICKNESS_MM])
    corners = np.array([[0.0, 0.0], [0.0, root], upper, [-16.0, THICKNESS_MM]])
    return corners, (ROOT_FACE, BEVEL_FACE, UPPER_SURFACE)


def raw_outline(s):
    """The same before milling."""
    return np.array([[0.0, 0.0], [0.0, THICKNESS_MM], [-16.0, THICKNESS_MM]]), (ROOT_FACE, UPPER_SURFACE)


def section_hits(outline, lateral):
    """(u, v) and label where parallel rays at `lateral` meet an outline, seen from the upper side."""
    corners, faces = outline
    to_sensor = np.array([np.cos(VIEW), np.sin(VIEW)])
    sideways = np.array([-np.sin(VIEW), np.cos(VIEW)])
    at = corners @ sideways
    hit = np.full((len(lateral), 2), np.nan)
    label = np.full(len(lateral), UNLABELLED, np.uint8)
    for k, face in enumerate(faces):
        inside = (lateral >= at[k]) & (lateral < at[k + 1])
        part = ((lateral[inside] - at[k]) / (at[k + 1] - at[k]))[:, None]
        hit[inside] = corners[k] + part * (corners[k + 1] - corners[k])
        label[inside] = face
    return hit, label, to_sensor, sideways


def scan(frames, columns, radius_mm, rng, clamp, outline):
    s_frames = np.linspace(0, LENGTH_MM, frames)
    position, _, normal, across = edge_frames(s_frames, radius_mm)
    lateral = np.linspace(-1.0, 19.0, columns)
    x = np.tile(lateral, (frames, 1)).astype(np.float32)
    z = np.full((frames, columns), np.nan, np.float32)
    labels = np.zeros((frames, columns), np.uint8)
    poses = np.tile(np.eye(4), (frames, 1, 1))
    for i, s in enumerate(s_frames):
        hit, labels[i], to_sensor, sideways = section_hits(outline(s), lateral)
        z[i] = 200.0 - hit @ to_sensor
        x_axis = sideways[0] * normal[i] + sideways[1] * across[i]
        z_axis = -(to_sensor[0] * normal[i] + to_sensor[1] * across[i])
        origin = position[i] - 200.0 * z_axis
        poses[i, :3] = np.column_stack([x_axis, np.cross(z_axis, x_axis), z_axis, origin])
    z += rng.normal(0, 0.012, z.shape).astype(np.float32)
    clamped = (s_frames >= clamp[0]) & (s_frames <= clamp[1])
    z[clamped] = (188.0 + rng.normal(0, 0.012, (clamped.sum(), columns))).astype(np.float32)
    labels[clamped] = UNLABELLED
    keep = np.isfinite(z)
    outlier = keep & (rng.random(z.shape) < 0.004)
    z[outlier] += rng.normal(0, 3.0, outlier.sum()).astype(np.float32)
    keep &= ~outlier
    labels[~keep] = UNLABELLED
    s_seen = np.where(clamped, np.nan, s_frames)
    return s_seen, x, z, labels, keep, poses, int(outlier.sum())


def sections_of(count, radius_mm, s_seen, clamp, verdict_of):
    for i in range(count):
        s = (i + 0.5) / count * LENGTH_MM
        position, tangent, normal, across = (each[0] for each in edge_frames([s], radius_mm))
        hidden = clamp[0] <= s <= clamp[1]
        values = (None,) * 4 if hidden else (float(root_at(s)), 0.0031, float(angle_deg_at(s)), 0.021)
        verdict = "undecided" if hidden else verdict_of(i)
        reason = "the edge is hidden here" if hidden else ""
        with np.errstate(invalid="ignore"):
            frames = np.flatnonzero(np.abs(s_seen - s) < 2.0)
        yield Section(i + 1, s, position, tangent, normal, across, bevel_sizes(*values), verdict, reason, frames)


def edge_of(kind, **known):
    """An edge with what the report looks at; the rest is left out, so that the report cannot rest on it."""
    return kind(**{field.name: known.get(field.name) for field in dataclasses.fields(kind)})


def scanned(kind, outline, *, radius_mm, frames, columns, clamp, part_id, seed, **known):
    """The cloud of a part and its edge of a kind, as measured without error, hidden under the clamp."""
    rng = np.random.default_rng(seed)
    s_seen, x, z, labels, keep, poses, outliers = scan(frames, columns, radius_mm, rng, clamp, outline)
    cloud = Cloud(
        x,
        z,
        keep,
        poses,
        np.arange(frames) / 50.0,
        np.zeros(frames, np.int64),
        source="edge.h5",
        part=Part(part_id=part_id),
        rejected={"isolated": outliers - 3, "mixed pixel": 3},
    )
    s = np.arange(0.0, LENGTH_MM + 0.5, 1.0)
    seen = ~((s >= clamp[0]) & (s <= clamp[1]))
    p, t, n, m = edge_frames(s, radius_mm)
    hide = np.where(seen, 0.0, np.nan)
    told = {"burr_stations": np.arange(0), "warnings": ()} | known
    told |= {"upper_position_mm": p + THICKNESS_MM * m + hide[:, None], "upper_inward": -n} if kind is RawEdge else {}
    edge = edge_of(
        kind,
        labels=labels,
        frame_arc_length_mm=s_seen,
        arc_length_mm=s,
        position_mm=p + hide[:, None],
        tangent=t,
        normal=n,
        across=m,
        seen=seen,
        **told,
    )
    return cloud, edge, hide, rng


def make_part(
    *, radius_mm=None, frames=400, columns=300, clamp=(90.0, 122.0), verdict="pass", part_id="B-17", seed=1, sections=9
):
    hidden = (f"edge hidden from {clamp[0]:.0f} to {clamp[1]:.0f} mm",) if clamp[1] >= 0.0 else ()
    shape = {"radius_mm": radius_mm, "frames": frames, "columns": columns, "clamp": clamp}
    told = {"part_id": part_id, "seed": seed, "burr_stations": np.array([31, 32, 170]), "warnings": hidden}
    cloud, edge, hide, rng = scanned(MilledEdge, milled_outline, **shape, **told)
    s = edge.arc_length_mm
    unsure = 1.0 + 0.3 * np.sin(s / 9) ** 2
    profile = EdgeProfile(
        s,
        edge_frames(s, radius_mm)[0],
        root_at(s) + rng.normal(0, 0.004, len(s)) + hide,
        0.0062 * unsure + hide,
        angle_deg_at(s) + rng.normal(0, 0.03, len(s)) + hide,
        0.045 * unsure + hide,
    )
    s_seen = edge.frame_arc_length_mm
    measured = tuple(sections_of(sections, radius_mm, s_seen, clamp, lambda i: verdict if i in (2, 5) else "pass"))
    inspection = Inspection(
        measured,
        profile,
        Requirements(),
        1.645,
        verdict,
        f"the part is made to {verdict}",
        "whole edge",
        part=cloud.part,
        warnings=("the tilt of the root face rests on 1.5 mm of width",),
    )
    return Inspected(cloud, edge, inspection)


@dataclass(frozen=True)
class Planned:
    """A raw edge and the path of its bevel by formula, ROOT_MM and BEVEL_DEG, in layers of 1 mm."""

    cloud: Cloud
    edge: RawEdge
    toolpath: Toolpath


def layer_by_formula(index, height_mm, radius_mm, clamp, bevel_deg):
    """A layer `height_mm` above the finished bevel, lifted by 12 mm over the clamp; leads of 5 mm rise by 2 mm."""
    s = np.arange(-5.0, LENGTH_MM + 5.5)
    position, tangent, normal, across = edge_frames(s, radius_mm)
    beta = bevel_deg * DEG
    low = np.array([0.0, ROOT_MM + height_mm / np.sin(beta)])
    high = np.array([-(THICKNESS_MM - low[1]) * np.tan(beta), THICKNESS_MM])
    hidden = (s >= clamp[0]) & (s <= clamp[1])
    cutting = (s >= 0) & (s <= LENGTH_MM) & ~hidden
    lift = np.where(hidden, 12.0, np.where(cutting, 0.0, 0.4 * np.clip(np.maximum(-s, s - LENGTH_MM), 0.0, 5.0)))
    u, v = ((low + high) / 2)[:, None] + np.array([np.cos(beta), np.sin(beta)])[:, None] * lift
    z = np.sin(beta) * normal - np.cos(beta) * across
    axes = np.stack([np.cross(tangent, z), tangent, z], axis=2)
    return Layer(
        index,
        height_mm,
        s,
        position + u[:, None] * normal + v[:, None] * across,
        Rotation.from_matrix(axes).as_quat(scalar_first=True),
        np.where(cutting, 1.0, 10.0),
        cutting,
        ~hidden,
        np.where(cutting, np.linalg.norm(high - low), 0.0),
    )


def path_by_formula(*, radius_mm=None, clamp=(90.0, 122.0), bevel_deg=BEVEL_DEG, **known):
    """Layers from 5 mm above the finished bevel down to it; between them 20 mm/s back, 30 mm above the plate."""
    layers = tuple(layer_by_formula(k + 1, 5.0 - k, radius_mm, clamp, bevel_deg) for k in range(6))
    up = edge_frames([0.0], radius_mm)[3]
    first, last = layers[0].position_mm[0] + 30.0 * up, layers[0].position_mm[-1] + 30.0 * up
    back = Travel(np.vstack([last, first]), layers[0].quaternion_wxyz[[-1, 0]], np.array([20.0, 20.0]))
    out = Travel(last, layers[0].quaternion_wxyz[[-1]], np.array([20.0]))
    return Toolpath(
        Cutter(),
        layers,
        (*[back] * len(layers), out),
        ROOT_MM,
        bevel_deg,
        depth_of_cut_mm=1.0,
        v_slow_mm_s=1.0,
        edge_length_mm=LENGTH_MM,
        part=Part(part_id="B-17"),
        **known,
    )


def make_planned(*, radius_mm=None, frames=200, columns=200, clamp=(90.0, 122.0), part_id="B-17", seed=2):
    count = round(LENGTH_MM) + 1
    known = {"position_u_mm": np.tile([0.006, 0.004], (count, 1)), "normal_u": np.full(count, 0.0005)}
    shape = {"radius_mm": radius_mm, "frames": frames, "columns": columns, "clamp": clamp}
    cloud, edge, *_ = scanned(RawEdge, raw_outline, **shape, part_id=part_id, seed=seed, **known)
    return Planned(cloud, edge, path_by_formula(radius_mm=radius_mm, clamp=clamp))


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are made, before they are written."""
    figures = []
    monkeypatch.setattr(Figure, "svg", lambda figure: figures.append(figure) or b"<svg/>")
    return figures


@pytest.fixture(scope="session")
def planned():
    """Builds a `Planned`; keyword arguments choose its shape."""
    return functools.cache(make_planned)


@pytest.fixture(scope="session")
def by_formula():
    """Builds a `Toolpath`."""
    return path_by_formula


@pytest.fixture(scope="session")
def part():
    """Builds a `Part`; keyword arguments choose its shape and verdict."""
    return make_part


@pytest.fixture(scope="session")
def provenance():
    return Provenance(
        title="Inspect a milled bevel",
        inputs=(("recording", "data/milled_edge.h5", "ab" * 32),),
        versions={"python": "3.11.2", "workbench": "0.1.0"},
        pipeline={"version": 1, "stages": [{"stage": "scan.read"}, {"stage": "report.html"}]},
        seed=7,
    )


REPORT = Path(workbench.report.__file__).parent
VOID = {"meta", "img", "br", "hr"}


class Elements(HTMLParser):
    """Collects start tags with their attributes, all text and all scripts; every element must end where it belongs."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.scripts: list[str] = []
        self.open: list[str] = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] == ["script"]:
            self.scripts.append(data)
        else:
            self.text += data

    def scripts_are_the_reports_own(self) -> bool:
        """Scenes, which are JSON and run nothing, and the one viewer."""
        viewer = "".join((REPORT / name).read_text(encoding="utf-8") for name in ("painter.js", "viewer.js"))
        scenes = [attributes for tag, attributes in self.tags if tag == "script" and attributes]
        assert all(each == {"type": "application/json", "class": "scene"} for each in scenes)
        *data, last = self.scripts
        assert all(json.loads(text)["blocks"] is not None for text in data)
        return last.strip() == viewer.strip() and len(data) == len(scenes)


@pytest.fixture(scope="session")
def elements():
    return Elements


@pytest.fixture(scope="session")
def hostile():
    """A name that is an attack where it is taken for HTML, a template or a path."""
    return '<script>alert("x")</script>\n& {{ 7*7 }} ../../etc'


@pytest.fixture
def quick(monkeypatch):
    """Leaves the views in space undrawn, for what does not depend on their pictures; lists them instead."""
    views = []
    monkeypatch.setattr("workbench.report.scene.picture", lambda view: views.append(view) or b"\x89PNG")
    return views


def text_of(chapter):
    """What a reader reads, blanks and breaks as one blank."""
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", chapter.certificate + chapter.html)))


def with_text(figures, *words):
    """The one figure that shows all these texts."""
    said = [{text.text for axes in figure.axes for text in axes.texts} for figure in figures]
    (found,) = [figure for figure, texts in zip(figures, said, strict=True) if set(words) <= texts]
    return found
