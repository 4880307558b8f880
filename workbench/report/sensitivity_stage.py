"""The stage `report.sensitivity`: which link between sensor and cutter costs how much, and what to improve first.

A link that displaces the cutter against the edge by e moves the bevel face by b . e along its normal b, and the root
size by b . e / sin(bevel); one that turns it about the feed turns the bevel by as much. Links are independent: squares
add (JCGM 100, 5.1.2). A measured first cut takes out what both cuts share (`path.correct`): of a link remains `left`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Chapter, Document, Edge, RawEdge, Toolpath, u_name
from workbench.artefacts.edges import ROOT_AND_BEVEL, Deviations
from workbench.errors import InputError
from workbench.report.text import render
from workbench.result_files import InspectionFile, RobotFile, ToolFile, TurntableFile, result_file
from workbench.stage import InputFile, stage
from workbench.units import DEG, Float

STEEL_PER_K = 11.5e-6  # thermal expansion
UNIFORM = math.sqrt(3.0)  # half a range over its standard deviation


class Link(NamedTuple):
    """One link of the chain, as standard uncertainties."""

    name: str
    source: str  # where its numbers come from, in words
    along_b_u_mm: float  # of the face's place, along its normal
    tilt_u_deg: float  # of its direction, about the feed
    left: float  # share that remains after a correction by a measured cut
    why_left: str


class Need(NamedTuple):
    """One characteristic: its tolerance, and how the chain serves it."""

    name: str
    unit: str
    half_width: float  # of the tolerance, the narrower side
    u: tuple[float, ...]  # of each link, in the order of the chain

    @property
    def total(self) -> float:
        """Combined standard uncertainty."""
        return math.sqrt(sum(u * u for u in self.u))

    @property
    def holds(self) -> bool:
        """Whether U = 2 u fits into the tolerance: about 95 % of the places, and no room for anything else."""
        return 2.0 * self.total <= self.half_width

    @property
    def worst(self) -> int:
        """The link that costs most."""
        return max(range(len(self.u)), key=lambda k: self.u[k])

    def share(self, link: int) -> float:
        """Of the variance."""
        return self.u[link] ** 2 / max(self.total**2, 1e-300)

    def without(self, link: int) -> float:
        """Combined standard uncertainty if this link were perfect."""
        return math.sqrt(max(self.total**2 - self.u[link] ** 2, 0.0))

    def allowed(self, link: int) -> float | None:
        """Greatest u of a link, all others as they are, with which U = 2 u fits; None: not by this link alone."""
        left = (self.half_width / 2.0) ** 2 - self.without(link) ** 2
        return math.sqrt(left) if left > 0.0 else None


def needs(
    links: Sequence[Link], measured: bool, bevel: float, root_half_mm: float, bevel_half_deg: float
) -> tuple[Need, Need]:
    """Root face and bevel angle (`bevel` in rad): milled blindly, or corrected by a measured cut."""
    share = [link.left if measured else 1.0 for link in links]
    root = tuple(link.along_b_u_mm * s / math.sin(bevel) for link, s in zip(links, share, strict=True))
    tilt = tuple(link.tilt_u_deg * s for link, s in zip(links, share, strict=True))
    return Need("root face", "mm", root_half_mm, root), Need("bevel angle", "deg", bevel_half_deg, tilt)


def thermal_mm(kelvin: float, length_mm: float) -> float:
    """Standard uncertainty of a length of steel over ± `kelvin` of any temperature (uniform)."""
    return STEEL_PER_K * kelvin * length_mm / UNIFORM


def sensitivity_html(links: Sequence[Link], blind: Sequence[Need], corrected: Sequence[Need]) -> tuple[str, str]:
    """The chapter, and the loop in one line."""
    ways = [("Milled without correction", blind), ("Corrected by a measured cut", corrected)]
    tables = [
        {
            "title": f"{title}: {need.name}",
            "unit": "mm" if need.unit == "mm" else "°",
            "verdict": _verdict(need, links),
            "rows": [_row(links[k], need, k) for k in sorted(range(len(need.u)), key=lambda k: -need.u[k])],
        }
        for title, needs in ways
        for need in needs
    ]
    left = [(link.name, link.source, f"{link.left:.2f}", link.why_left) for link in links]
    root = f"root face: U = {2 * blind[0].total:.2f} mm without correction, {2 * corrected[0].total:.2f} mm with it"
    first = (
        f"largest contribution: {links[blind[0].worst].name} without, {links[corrected[0].worst].name} with correction"
    )
    return render("sensitivity.html.j2", tables=tables, left=left), f"{root}; {first}"


def _verdict(need: Need, links: Sequence[Link]) -> str:
    holds = "is within" if need.holds else "exceeds"
    said = f"U = 2 u = {2 * need.total:.3f} {need.unit} {holds} the tolerance of ± {need.half_width:g} {need.unit}"
    first, allowed = links[need.worst].name, need.allowed(need.worst)
    if need.holds:
        return f"{said}. Largest contribution: {first}."
    if allowed is None:
        return f"{said}. Largest contribution: {first}; reducing it alone is not enough."
    return f"{said}. Largest contribution: {first}; within the tolerance at u = {allowed:.3f} {need.unit}."


def _row(link: Link, need: Need, k: int) -> tuple[str, ...]:
    allowed = need.allowed(k)
    return (
        link.name,
        f"{need.u[k]:.4f}",
        f"{100 * need.share(k):.0f} %",
        f"{2 * need.without(k):.3f}",
        "–" if allowed is None else f"{allowed:.3f}",
    )


PAPER_HAND_EYE_MM = 0.41  # the paper's section 7, as a length
HAND_EYE_DEG = 0.05  # where its calibration has no covariance
INSPECTED_MM, INSPECTED_DEG = 0.044, 0.052  # mean u of a section: median over simulated conditions
CALIBRATED = "its calibration"
LINK_IN_FILE = ("name", "source", "along_b_u_mm", "tilt_u_deg", "left")
Length = Annotated[float, Field(ge=0, le=100)]
Angle = Annotated[float, Field(ge=0, le=20)]


@stage("report.sensitivity")
def sensitivity(
    toolpath: Toolpath,
    edge: Edge,
    *,
    root_tolerance_mm: Deviations = (
        -0.5,
        0.5,
    ),
    bevel_tolerance_deg: Deviations = (
        -1.0,
        1.0,
    ),
    tool: InputFile | None = None,
    turntable: InputFile | None = None,
    hand_eye_mm: Annotated[float | None, Field(ge=0, le=100)] = None,
    hand_eye_deg: Annotated[float | None, Field(ge=0, le=20)] = None,
    robot_calibration: InputFile | None = None,
    robot_accuracy_mm: Length = 0.1,
    robot_repeatability_mm: Length = 0.03,
    robot_deg: Angle = 0.01,
    tool_mm: Length = 0.2,
    tool_deg: Angle = 0.05,
    turntable_mm: Length = 0.0,
    turntable_deg: Angle = 0.0,
    temperature_k: Annotated[float, Field(ge=0, le=100)] = 3.0,
    drift_k: Annotated[float, Field(ge=0, le=100)] = 0.5,
    wear_mm: Length = 0.05,
    inspection: InputFile | None = None,
    inspection_mm: Annotated[float | None, Field(ge=0, le=100)] = None,
    inspection_deg: Annotated[float | None, Field(ge=0, le=20)] = None,
) -> tuple[Chapter, Document]:
    """What each link of the chain contributes to root face and bevel angle, and what to improve first.

    Standard uncertainties of the bevel face's place and direction, milled without and with a finishing pass corrected
    by a measured cut (docs/planning.md, "Error budget of the chain").

    Args:
        toolpath: the path: bevel, layers, and how far from the robot's base the part lies.
        edge: the scanned edge: its u is the sensor's share.
        root_tolerance_mm: allowed deviations from the nominal root face.
        bevel_tolerance_deg: allowed deviations from the nominal bevel angle.
        tool: a tcp.json, whose u replaces tool_mm and tool_deg.
        turntable: a turntable.json, likewise.
        hand_eye_mm: standard uncertainty of a point by the hand-eye pose (three axes together); null: by the scan's
            covariance.
        hand_eye_deg: of its direction about the feed; null: by its file.
        robot_calibration: as in `path.layers`.
        robot_accuracy_mm: of the robot between scan and cut, along an axis.
        robot_repeatability_mm: of the robot along an axis.
        robot_deg: of its orientation between scan and cut.
        tool_mm: of the tool's measured place, along an axis.
        tool_deg: of its measured axis.
        turntable_mm: of a point by the turntable's axis; 0: it does not move.
        turntable_deg: of the part's direction by it.
        temperature_k: half the range between calibration and cut.
        drift_k: half the range between the two cuts.
        wear_mm: loss of the cutter's radius before it is replaced.
        inspection: an inspection.json of a similar part, whose u replaces inspection_mm and inspection_deg.
        inspection_mm: u of an inspected root face; null: the larger of this scan's and the median of simulated
            inspections (0.044 mm).
        inspection_deg: u of an inspected bevel angle; null: likewise.

    Raises:
        InputError: a file of another kind; an inspection in which nothing was measured.

    Example:
        >>> from workbench import edge, path, report, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> chapter, document = report.sensitivity(path.layers(raw, points), raw)
        >>> chapter.title, document.name
        ('Error budget of the milled bevel', 'sensitivity.json')
    """
    bevel, sine = toolpath.bevel_deg * DEG, math.sin(toolpath.bevel_deg * DEG)
    eye_from, eye_mm, eye_deg = _hand_eye(toolpath, edge, hand_eye_mm, hand_eye_deg)
    sensor_mm, sensor_deg = _of_edge(edge, bevel)
    tool_from, table_from, robot_from = "given", "given", "given"
    if tool is not None:
        declared, tool_from = ToolFile.read_for(tool, toolpath.part), CALIBRATED
        tool_mm, tool_deg = declared.points[0].u_mm, tool_deg if declared.axis is None else declared.axis.u_deg
    if turntable is not None:
        table, table_from = TurntableFile.read_for(turntable, toolpath.part), CALIBRATED
        turntable_mm, turntable_deg = table.u_mm, table.direction_u_deg
    if robot_calibration is not None:
        robot_accuracy_mm, robot_from = RobotFile.read_for(robot_calibration, toolpath.part).u_mm, CALIBRATED
    reach = float(np.linalg.norm(toolpath.in_base(toolpath.layers[-1].position_mm), axis=1).mean())
    warm, drifts = thermal_mm(temperature_k, reach), thermal_mm(drift_k, reach)
    # The correction's own mean rests on one run of the robot: what that run did by chance goes into the next.
    chance = math.sqrt(1.0 + 1.0 / max(1.0, toolpath.edge_length_mm / 100.0))
    uniform = wear_mm / math.sqrt(3.0)
    links = (
        Link("sensor", "the scanned edge", sensor_mm, sensor_deg, 0.0, "the measurement of the cut takes its place"),
        Link("hand-eye", eye_from, eye_mm, eye_deg, 0.0, "both scans and both cuts share it"),
        Link("robot, systematic", robot_from, robot_accuracy_mm, robot_deg, 0.0, "both cuts go the same way"),
        Link(
            "robot, random",
            "given",
            robot_repeatability_mm,
            0.0,
            chance,
            "new in the finishing pass, and a little of the first cut's",
        ),
        Link("tool", tool_from, tool_mm, tool_deg, 0.0, "both cuts share it"),
        Link(
            "turntable", table_from, turntable_mm, turntable_deg, 0.0, "both cuts share it, if it stands between them"
        ),
        Link(
            "temperature",
            f"{temperature_k:g} K over {reach / 1000.0:.2f} m of steel",
            warm,
            0.0,
            drifts / warm if warm > 0.0 else 0.0,
            "what changes between the cuts",
        ),
        Link("wear", "given", uniform, 0.0, 1.0 / (len(toolpath.layers) + 1), "only the finishing pass's own"),
    )
    cut_from, cut_mm, cut_deg = _inspected(inspection, edge, inspection_mm, inspection_deg)
    measured = Link("measurement of the cut", cut_from, cut_mm * sine, cut_deg, 1.0, "it is new")
    root_half, bevel_half = (min(-low, high) for low, high in (root_tolerance_mm, bevel_tolerance_deg))
    blind = needs(links, False, bevel, root_half, bevel_half)
    corrected = needs((*links, measured), True, bevel, root_half, bevel_half)
    html, summary = sensitivity_html((*links, measured), blind, corrected)
    document = {
        "part": dataclasses.asdict(toolpath.part),
        "bevel_deg": toolpath.bevel_deg,
        "links": [{key: getattr(link, key) for key in LINK_IN_FILE} for link in (*links, measured)],
        "characteristics": [
            {
                "name": need.name,
                "unit": need.unit,
                "way": way,
                "tolerance_half_width": need.half_width,
                "u": need.total,
                "holds": need.holds,
                "improve_first": chain[need.worst].name,
                "links": [
                    {"name": link.name, "u": u, "share": need.share(k), "allowed_u": need.allowed(k)}
                    for k, (link, u) in enumerate(zip(chain, need.u, strict=True))
                ],
            }
            for way, chain, both in (("blind", links, blind), ("corrected", (*links, measured), corrected))
            for need in both
        ],
    }
    return (
        Chapter("Error budget of the milled bevel", html, summary=summary, part=toolpath.part),
        result_file("sensitivity.json", document),
    )


def _of_edge(edge: Edge, bevel: float) -> tuple[float, float]:
    """u of the planned face along b, mm, and of its direction, deg: the scan's own."""
    if not isinstance(edge, RawEdge):
        return 0.0, 0.0
    return _across(edge.position_u_mm, bevel), _turn_deg(edge)


def _across(u_mm: Float, bevel: float) -> float:
    """u along the bevel's normal of places (n, 2) along the edge's n and m, the median of them."""
    return float(np.nanmedian(np.hypot(u_mm[:, 0] * math.cos(bevel), u_mm[:, 1] * math.sin(bevel))))


def _turn_deg(edge: RawEdge) -> float:
    """u of the end face's direction about the edge, without what the hand-eye pose has in it."""
    shared = 0.0 if edge.hand_eye_turn is None else edge.hand_eye_turn
    return float(np.median(np.sqrt(np.maximum(edge.normal_u**2 - np.square(shared), 0.0)))) / DEG


def _hand_eye(toolpath: Toolpath, edge: Edge, mm: float | None, deg: float | None) -> tuple[str, float, float]:
    """Where it comes from, u along the bevel's normal, and u of the direction about the feed, deg."""
    raw = edge if isinstance(edge, RawEdge) and edge.hand_eye_u_mm is not None else None
    if deg is None:
        turn = None if raw is None else raw.hand_eye_turn
        deg = HAND_EYE_DEG if turn is None else float(np.median(turn)) / DEG
    if mm is not None:
        return "given", mm / math.sqrt(3.0), deg
    if raw is not None and raw.hand_eye_u_mm is not None:
        return CALIBRATED, _across(raw.hand_eye_u_mm, toolpath.bevel_deg * DEG), deg
    part_mm = toolpath.part.hand_eye_u_mm
    if part_mm is not None:
        return CALIBRATED, part_mm / math.sqrt(3.0), deg
    return "the paper's", PAPER_HAND_EYE_MM / math.sqrt(3.0), deg


def _inspected(path: Path | None, edge: Edge, mm: float | None, deg: float | None) -> tuple[str, float, float]:
    """Where it comes from, u of a root face, mm, and of a bevel angle, deg."""
    if path is not None:
        rows = [
            row
            for row in InspectionFile.read(path).sections
            if all(getattr(row, u_name(name)) is not None for name in ROOT_AND_BEVEL)
        ]
        if not rows:
            raise InputError(f"{path}: $.sections", "expected one that was measured")
        root, bevel = (np.array([getattr(row, name) for row in rows]) for name in map(u_name, ROOT_AND_BEVEL))
        return "an inspection", float(np.sqrt(np.mean(root**2))), float(np.sqrt(np.mean(bevel**2)))
    said = "given" if mm is not None and deg is not None else "inspections of such scans"
    two_mm, two_deg = 0.0, 0.0
    if isinstance(edge, RawEdge):  # a size is told by two of its places
        two_mm, two_deg = (
            math.sqrt(2.0) * float(np.nanmedian(edge.position_u_mm[:, 1])),
            math.sqrt(2.0) * _turn_deg(edge),
        )
    return said, max(INSPECTED_MM, two_mm) if mm is None else mm, max(INSPECTED_DEG, two_deg) if deg is None else deg
