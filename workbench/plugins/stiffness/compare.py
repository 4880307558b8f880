"""`stiffness.compare`: what the compensation of deflection has changed in the milled part."""

from __future__ import annotations

import base64
import io

import numpy as np

from workbench.api import Chapter, Document, EdgeProfile, Float, Inspection, PathDeflection, stage, strict_json


@stage("stiffness.compare")
def compare(without: Inspection, compensated: Inspection, bending: PathDeflection) -> tuple[Document, Chapter]:
    """Root and bevel angle as inspected, of a part milled as planned and of one milled along the corrected path.

    Args:
        without: the part that was milled along the path as planned.
        compensated: the part that was milled along the corrected one.
        bending: how far the cutter gave way while both were milled.
    """
    errors = {name: _errors(one) for name, one in (("without", without), ("compensated", compensated))}
    gave = np.concatenate([np.linalg.norm(moved, axis=1) for moved in bending.by_layer_mm.values()])
    root = {name: found["mean_root_error_mm"] for name, found in errors.items()}
    summary = (
        f"Mean root error {root['without']:+.3f} mm without compensation, {root['compensated']:+.3f} mm with it; the "
        f"cutter gave way by up to {gave.max():.3f} mm"
    )
    rows = "".join(
        f"<tr><td>{name}</td>" + "".join(f"<td>{value:+.4f}</td>" for value in found.values()) + "</tr>"
        for name, found in errors.items()
    )
    picture = base64.b64encode(_picture(without, compensated)).decode()
    text = (
        "<table><tr><th></th><th>mean root error, mm</th><th>largest root error, mm</th><th>mean angle error, deg</th>"
        f"<th>largest angle error, deg</th></tr>{rows}</table>"
        f'<img alt="Root and angle along the edge, both parts" style="max-width:100%" '
        f'src="data:image/svg+xml;base64,{picture}">'
    )
    document = strict_json({"format": "compensation", "version": 1, "largest_deflection_mm": gave.max(), **errors})
    return Document("compensation.json", document), Chapter(
        "Deflection, without and with compensation", text, summary=summary
    )


def _errors(inspection: Inspection) -> dict[str, float]:
    """Mean and largest deviation from nominal of the sections' root and angle."""
    wanted = inspection.requirements
    root = np.array([section.root_mm for section in inspection.sections]) - wanted.root_nominal_mm
    bevel = np.array([section.bevel_deg for section in inspection.sections]) - wanted.bevel_nominal_deg
    return {
        "mean_root_error_mm": float(np.nanmean(root)),
        "largest_root_error_mm": _largest(root),
        "mean_bevel_error_deg": float(np.nanmean(bevel)),
        "largest_bevel_error_deg": _largest(bevel),
    }


def _largest(errors: Float) -> float:
    return float(errors[np.nanargmax(np.abs(errors))])


def _picture(without: Inspection, compensated: Inspection) -> bytes:
    """Root and bevel angle along the edge, of both parts (SVG)."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    wanted = without.requirements
    with rc_context({"svg.hashsalt": "compare", "svg.fonttype": "none", "font.size": 8}):
        figure = Figure(figsize=(8, 4.2), layout="constrained")
        top, below = figure.subplots(2, 1, sharex=True)
        for name, one in (("without", without), ("compensated", compensated)):
            profile: EdgeProfile = one.profile
            top.plot(profile.arc_length_mm, profile.root_mm, lw=1, label=name)
            below.plot(profile.arc_length_mm, profile.bevel_deg, lw=1, label=name)
        top.axhline(wanted.root_nominal_mm, color="0.4", lw=0.8, ls=":")
        below.axhline(wanted.bevel_nominal_deg, color="0.4", lw=0.8, ls=":")
        top.set_ylabel("root, mm")
        below.set_ylabel("bevel angle, deg")
        below.set_xlabel("arc length, mm")
        top.legend(frameon=False, ncols=2)
        drawing = io.BytesIO()
        figure.savefig(drawing, format="svg", metadata={"Date": None, "Creator": None})
    return drawing.getvalue()
