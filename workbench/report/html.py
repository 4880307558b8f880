"""The stage `report.html`: one page to sign under, complete in one file."""

from __future__ import annotations

import warnings
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, Document, Edge, Inspection, Provenance
from workbench.errors import InputError
from workbench.stage import stage


@stage("report.html")
def html(
    cloud: Cloud,
    edge: Edge,
    inspection: Inspection,
    provenance: Provenance | None = None,
    *,
    points: Annotated[
        int, Field(ge=10_000, le=1_000_000, description="about how many points a view in space shows at most")
    ] = 300_000,
) -> Document:
    """The inspection as a self-contained page, `report.html`: verdict, drawings, charts, tables, provenance.

    The cloud coloured by face with the section planes; each section's points and fitted lines, root and angle
    dimensioned; root size and bevel angle along the edge (the paper's Figs. 20 and 21) with tolerance, guard and
    uncertainty bands; what was rejected. Uncertainties are expanded, U = 2 u. The views in space are drawn by VTK
    offscreen in a process of its own, and in a simpler manner where VTK cannot start (the page then says why).
    Needs no network to open; the same input gives the same page but for the pixels of the views in space.

    Args:
        cloud: the cloud that was inspected; it is thinned before it is drawn, never copied.
        edge: its faces, and the lower edge along which everything is laid out.
        inspection: what was measured, required and decided.
        provenance: inputs, versions, pipeline and seed; the runner supplies it, without it the page says so.
        points: about how many points a view in space shows at most.
    """
    # Matplotlib and jinja2 cost time to import: only where a report is made.
    from workbench.report.along import angle_chart, root_chart
    from workbench.report.drawing import section_drawings
    from workbench.report.page import Figures, page
    from workbench.report.plan import plan_view
    from workbench.report.rendering import Rendering
    from workbench.report.scene import views

    if not inspection.sections:
        raise InputError(cloud.source or "inspection", "expected at least one section to report")
    if not np.isfinite(edge.position_mm).all(axis=1).any():
        raise InputError(cloud.source or "edge", "expected an edge of which something was measured")
    rendering = Rendering(views(cloud, edge, inspection, points))  # draws while the charts are made
    sections = section_drawings(cloud, edge, inspection)
    root, angle = root_chart(edge, inspection), angle_chart(edge, inspection)
    plan = plan_view(cloud, edge, inspection)
    pictures = rendering.pictures()
    if pictures.problem:
        warnings.warn(pictures.problem, RuntimeWarning, stacklevel=2)
    figures = Figures(pictures, sections, root, angle, plan)
    return Document("report.html", page(cloud, edge, inspection, provenance, figures).encode())
