"""This project: the public stages, with their defaults but for what is declared."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from workbench import cloud, edge, inspect, scan
from workbench.artefacts import JointInspection, u_name
from workbench.units import DEG

TITLE = "workbench"
TRACKS = ("milled", "raw", "groove", "hand_eye")
STATIONS = 5  # one in so many stations of a raw edge is told, the same from either end


def measure(recording: Path, declared: Mapping[str, Any]) -> dict[str, Any]:
    """A submission's entry of one recording."""
    read = scan.read(recording=recording)
    if declared["kind"] == "sphere":
        return hand_eye(read, declared)
    points = cloud.denoise(scan.fuse(read))
    known: dict[str, Any] = {"robot_noise_mm": declared["robot_noise_mm"]} if "robot_noise_mm" in declared else {}
    known["edge_condition"] = declared.get("edge_condition", "unknown")
    if "sensor" in declared:
        known["sensor"] = recording.with_suffix(".sensor.json")
        known["sensor"].write_text(json.dumps(declared["sensor"]))
    if declared["kind"] == "groove":
        return sections(inspect.groove(edge.segment_groove(points, **known)), "gap_mm", "depth_mm")
    if declared["kind"] == "raw":
        known |= {name: declared[name] for name in ("robot_noise_length_mm",) if name in declared}
        drift = declared.get("robot_drift_u_mm", 0.0)
        raw = edge.segment_raw(points, upper_side=tuple(declared["upper_side"]), robot_drift_u_mm=drift, **known)
        return {"sections": raw_sections(raw)}
    known |= {"upper_side": tuple(declared["upper_side"])} if "upper_side" in declared else {}
    nominal = {name: declared[name] for name in ("root_nominal_mm", "bevel_nominal_deg")}
    return sections(inspect.sections(edge.segment(points, **nominal, **known), **nominal), "root_mm", "bevel_deg")


def sections(inspection: JointInspection, *sizes: str) -> dict[str, Any]:
    """Where sections lie, two sizes with their u, and their verdicts beside the part's."""
    names = [each for size in sizes for each in (size, u_name(size))]
    return {
        "verdict": inspection.verdict,
        "sections": [
            {"origin_mm": s.origin_mm.tolist(), "verdict": s.verdict, **{name: s.values.get(name) for name in names}}
            for s in inspection.sections
        ],
    }


def raw_sections(raw: Any) -> list[dict[str, Any]]:
    """Some of the stations that were measured, the first and the last one too."""
    assert raw.position_u_mm is not None
    at = np.flatnonzero(raw.seen & np.isfinite(raw.position_mm[:, 0]))
    at = at[np.linspace(0, at.size - 1, at.size // STATIONS + 1).round().astype(int)]
    columns = {
        "origin_mm": raw.position_mm,
        "normal": raw.normal,
        "tangent": raw.tangent,
        "along_n_u_mm": raw.position_u_mm[:, 0],
        "along_m_u_mm": raw.position_u_mm[:, 1],
        "axis_u_deg": raw.normal_u / DEG,
        "heading_u_deg": raw.tangent_u / DEG,
    }
    return [{name: np.asarray(column[k]).tolist() for name, column in columns.items()} for k in at]


def hand_eye(read: Any, declared: Mapping[str, Any]) -> dict[str, Any]:
    """Pose and u of its parts."""
    from workbench.plugins import calibration

    known = {name: declared[name] for name in ("pose_noise_mm", "pose_noise_deg") if name in declared}
    found = calibration.hand_eye(calibration.circles(read), read, **known)[0]
    assert found.covariance is not None
    u = np.sqrt(np.diag(found.covariance))
    return {
        "flange_from_profiler": found.flange_from_profiler.tolist(),
        "translation_u_mm": u[:3].tolist(),
        "rotation_u_deg": (u[3:] / DEG).tolist(),
    }
