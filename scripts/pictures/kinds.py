"""How each kind of artefact is drawn: `DRAWN`, by its type's name, in the order of what says most.

A drawing gets the artefact, and beside it what its stage took and what came out with it: where a report draws it, it is
the report's own chart, in words or as its chapter. None: nothing to be drawn.
"""

from __future__ import annotations

import json

import numpy as np

from scripts.pictures.panels import MOST_DOTS, Curve, Panel, Picture, plan
from workbench import compare, inspect
from workbench.artefacts import Groove, Joint
from workbench.pieces import BLUE, GREY, ORANGE, PALE
from workbench.plugins.calibration.report_stage import residuals_picture
from workbench.report.along import deviation_chart, size_chart
from workbench.report.correction_stage import correction_chart
from workbench.report.groove_stage import groove_drawing
from workbench.report.path_charts import edges_in_plane
from workbench.report.planned import layer_colours
from workbench.report.section_drawing import of_interest
from workbench.robot.drawing import cell_strokes

ALONG, ARC = "arc length along the lower edge, mm", "arc length, mm"
JOINTS = [f"joint {k}" for k in range(1, 7)]
WITH_U = "with U = 2 u"
SLICE_MM, ARCS, MOST_NAMED = 0.4, 5, 6  # half the thickness of a slice; arcs drawn of a sphere; layers named


def first(beside, kind):
    return next((one for one in beside if type(one).__name__ == kind), None)


def rows(words, x, *panels):
    """Charts over the same x: (label, curves) or (label, curves, levels)."""
    return Picture(words, [Panel(x if k == len(panels) - 1 else "", *one) for k, one in enumerate(panels)])


def named(words, label, names, *curves):
    return Picture(words, [Panel(label, "", curves, names=names)])


def bars(words, label, names, values, u=None):
    return named(words, label, names, Curve(values, np.arange(len(names)), u=u, how="bars"))


def by_layer(layers, with_names=True):
    """Curves of (index, x, y), in the layers' colours."""
    shades = layer_colours(np.array([k for k, _, _ in layers]), len(layers)) / 255.0
    short = with_names and len(layers) <= MOST_NAMED
    return [
        Curve(x, y, f"layer {k}" if short else None, colour=shade)
        for (k, x, y), shade in zip(layers, shades, strict=True)
    ]


# Scans.


def recording(made, beside):
    k = len(made.x_mm) // 2
    there = np.isfinite(made.z_mm[k])
    returns = Curve(made.x_mm[k][there], made.z_mm[k][there], how="dots")
    words = f"Profile {k} of the recording's {len(made.x_mm)}, as the scanner sees it"
    return Picture(words, [Panel("x, lateral, mm", "z, range, mm", [returns], equal=True)])


def cloud(made, beside):
    before, points = first(beside, "Cloud"), made.points_mm
    if before is None:
        return plan(f"The cloud's {len(points)} points in the base", (None, points, BLUE))
    out = before.placed(*np.nonzero(before.keep & ~made.keep))
    words = f"The {len(points)} points that were kept, and the {len(out)} that were rejected"
    return plan(words, ("kept", points, BLUE), ("rejected", out, ORANGE))


def point_set(made, beside):
    before, points = first(beside, "PointSet"), made.points_mm
    if before is None:
        return plan(f"The {len(points)} points in the base", (None, points, BLUE))
    clouds = (("before", before.points_mm, PALE), ("after", points, BLUE))
    return plan(f"The {len(before.points_mm)} points before, and the {len(points)} after", *clouds)


def surface(made, beside):
    points, triangles = made.points_mm, made.triangles
    if triangles is None or len(triangles) > MOST_DOTS:
        return plan(f"The surface's {len(points)} points in the base", (None, points, BLUE))
    rings = points[triangles[:, [0, 1, 2, 0, 0]]]
    rings[:, 4] = np.nan  # the pen goes up
    return plan(f"The surface in the base, triangles: {len(triangles)}", (None, rings.reshape(-1, 3), BLUE), how="line")


def registration(made, beside):
    scan, reference = (one.points_mm for one in beside if type(one).__name__ == "Surface")
    pose, middle = made.reference_from_scan, np.median(reference, axis=0)
    axis = int(np.argmax(np.ptp(reference, axis=0)))
    moved = scan @ pose[:3, :3].T + pose[:3, 3]
    clouds = (("reference", reference, GREY), ("as recorded", scan, ORANGE), ("registered", moved, BLUE))
    slices = [(name, at[np.abs(at[:, axis] - middle[axis]) < SLICE_MM], colour) for name, at, colour in clouds]
    return plan("A scan as recorded and as registered, on the reference: a slice across the part", *slices)


# Edges and joints.


def milled_edge(made, beside):
    s = made.arc_length_mm
    root = Curve(s, made.root.value, u=2 * made.root.u)
    bevel = Curve(s, made.bevel.value, u=2 * made.bevel.u)
    words = f"Root face and bevel angle along the edge, {WITH_U} as bands"
    return rows(words, ALONG, ("root face, mm", [root]), ("bevel angle, °", [bevel]))


def raw_edge(made, beside):
    words = "Both edges in the plane of the end face, and how far they lie off that plane"
    return edges_in_plane(first(beside, "Cloud"), made), words


def joint(made, beside):
    found = inspect.groove(made) if isinstance(made, Groove) else inspect.preparation(made)
    words = f"Section of the {type(made).__name__.lower()} with its dimensions"
    return groove_drawing(first(beside, "Cloud"), made, of_interest(found)), words


def joint_inspection(made, beside):
    (one,) = (one for one in beside if isinstance(one, Joint))
    what, *_ = (size for size in made.characteristics if size.name in one.sizes)
    words = f"{what.term} along the joint and in its sections, {WITH_U}"
    return size_chart(one.arc_length_mm, one.sizes[what.name], one.seen, made, what), words


def inspection(made, beside):
    nominal = {one.name: one.required[0] for one in made.characteristics}
    words = "Deviations of root face and bevel angle from the requirement, along the edge and in the sections"
    return deviation_chart({"": made}, nominal), words


def study(made, beside):
    return compare.repeatability(made)[1]


# Paths.


def toolpath(made, beside):
    layers = [(f"layer {one.index}", made.in_base(one.position_mm), None) for one in made.layers]
    return plan(f"The path's layers in the base, {len(layers)} of them", *layers, how="line")


def rework(made, beside):
    return toolpath(made.toolpath, beside)


def correction(made, beside):
    return correction_chart(made), "Shift and tilt of the first cut along the edge, and their correction"


def moves(made, beside):
    path = np.vstack([layer.position_mm for layer in made.toolpath.layers])
    clouds = [
        (name, made.position_mm[made.cutting & kind], colour)
        for name, kind, colour in (("straight", ~made.circular, BLUE), ("circular", made.circular, ORANGE))
    ]
    words = f"Targets of the {len(made.feed_mm_s)} moves that are made of the path's {made.points_before} points"
    return plan(words, *(one for one in clouds if len(one[1])), ("path", path, GREY))


def engagement(made, beside):
    sizes = (
        ("radial_depth_mm", "radial depth, mm"),
        ("axial_depth_mm", "axial depth, mm"),
        ("chip_area_mm2", "chip area, mm²"),
    )
    panels = [
        (label, by_layer([(one.index, one.arc_length_mm, getattr(one, size)) for one in made.layers], k == 0))
        for k, (size, label) in enumerate(sizes)
    ]
    return rows("What the cutter meets along each layer", ARC, *panels)


# Calibration.


def sphere_profiles(made, beside):
    scan, some = first(beside, "Recording"), np.linspace(0, len(made.frame) - 1, ARCS).astype(int)
    x, z, on = (grid[made.frame[some]] for grid in (scan.x_mm, scan.z_mm, made.on_arc))
    curves = [
        Curve(x[on], z[on], "returns", how="dots", colour=BLUE),
        Curve(*made.circle[some, :2].T, "centres of their circles", how="marks", colour=ORANGE),
    ]
    words = f"Returns from the sphere and the centres of their circles, in {ARCS} of {len(made.frame)} frames"
    return Picture(words, [Panel("x, lateral, mm", "z, range, mm", curves, equal=True)])


def calibration(made, beside):
    return residuals_picture(made), "How far each posture lies from the fit of the others, over its u"


def validation(made, beside):
    names, k = [f"posture {k}" for k in range(1, len(made.frames) + 1)], np.arange(len(made.frames))
    curves = [
        Curve(made.error_mm[:, c], k + off, axis, 2 * made.u_mm[:, c], "marks")
        for c, axis, off in ((0, "x", -0.15), (2, "z", 0.15))
    ]
    words = f"Errors of the predicted sphere centre in postures that were left out, {WITH_U}"
    return named(words, "error in the profile, mm", names, *curves)


def posture_plan(made, beside):
    u = made.volume_u_mm
    words = "Uncertainty that the postures leave, one after the other"
    return rows(words, "postures added", ("u over the view, mm", [Curve(np.arange(len(u)), u)], [("now", float(u[0]))]))


def document(made, beside):
    found = json.loads(made.content) if made.name.endswith(".json") else {}
    if found.get("format") == "robot-calibration":
        panels = []
        for unit, label in (("deg", "offset, °"), ("mm", "shift, mm")):
            some = [one for one in found["parameters"] if f"value_{unit}" in one]
            value, u = (np.array([one[f"{key}_{unit}"] for one in some]) for key in ("value", "u"))
            names = [one["name"] for one in some]
            panels.append(Panel(label, "", [Curve(value, np.arange(len(some)), None, 2 * u, "marks")], names=names))
        return Picture(f"Errors of the robot's axes {WITH_U}: offsets of the joints, shifts of the axes", panels)
    return None


# Robot.


def cell(made, beside):
    curves = []
    for body in cell_strokes(made, np.zeros(6), 0.0):
        lines = np.pad(np.array(body.lines_mm), ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)  # each by itself
        colour = "#{:02x}{:02x}{:02x}".format(*body.colours[0][0])
        curves.append(Curve(*lines.reshape(-1, 3)[:, [0, 2]].T, colour=colour))
    words = "The cell from the side, all joints at 0: edges of its bodies, the robot's in orange"
    return Picture(words, [Panel("x of the base, mm", "z, mm", curves, equal=True)])


def stiffness(made, beside):
    words, u = f"Stiffness of each joint, {WITH_U}", 2e-6 * made.u_nm_per_rad
    return bars(words, "stiffness, MNm/rad", JOINTS, 1e-6 * made.nm_per_rad, u)


def robot_modes(made, beside):
    words, u = "Mass of each link, the tool on the sixth, with U = 2 u", np.sqrt(np.diag(made.covariance))[6:12]
    names = [f"link {k}" for k in range(1, 7)]
    return bars(words, "mass, kg", names, made.bodies.mass_kg, 2 * u * made.bodies.mass_kg)


def deflection(made, beside):
    return bars("How far the cutter's tip gives way", "displacement in the base, mm", "xyz", made.displacement_mm)


def load_plan(made, beside):
    words = "Standard uncertainty of each joint's stiffness that the planned loads promise"
    return bars(words, "u of its stiffness, %", JOINTS, 100.0 * made.relative_u)


def force(made, beside):
    layer = max(made.layers, key=lambda one: float(np.nanmax(np.abs(one.mean_n))))
    names = ("x into the material", "y along the feed", "z to the tip")
    curves = [Curve(layer.arc_length_mm, layer.mean_n[:, c], name) for c, name in enumerate(names)]
    return rows(f"Mean force on the cutter along layer {layer.index}, where it is largest", ARC, ("force, N", curves))


def path_deflection(made, beside):
    layers = [one for one in first(beside, "Toolpath").layers if one.index in made.by_layer_mm]
    panels = [
        (label, by_layer([(n.index, n.arc_length_mm, made.by_layer_mm[n.index][:, c]) for n in layers], c == 0))
        for c, label in enumerate(("x into the\nmaterial, mm", "y along the\nfeed, mm", "z to the tip,\nmm"))
    ]
    return rows("How far the tool gives way along each layer", ARC, *panels)


def postures(made, beside):
    k, moved = np.arange(len(made.layer)), np.linalg.norm(made.displacement_mm, axis=1)
    cut = [Curve(k, np.where(made.cutting, moved, np.nan))]
    words = "How far the cutter gives way where it cuts, and the robot's clearance, point by point"
    return rows(words, "point of the path", ("displacement, mm", cut), ("clearance, mm", [Curve(k, made.clearance_mm)]))


def chapter(made, beside):
    return made


DRAWN = {
    "Postures": postures,
    "Chapter": chapter,
    "Rework": rework,
    "PathCorrection": correction,
    "Engagement": engagement,
    "Moves": moves,
    "Registration": registration,
    "GrooveInspection": joint_inspection,
    "PreparationInspection": joint_inspection,
    "Inspection": inspection,
    "Groove": joint,
    "Preparation": joint,
    "MilledEdge": milled_edge,
    "PosturePlan": posture_plan,
    "Validation": validation,
    "Calibration": calibration,
    "SphereProfiles": sphere_profiles,
    "LoadPlan": load_plan,
    "PathDeflection": path_deflection,
    "MillingForce": force,
    "Deflection": deflection,
    "Toolpath": toolpath,
    "RawEdge": raw_edge,
    "JointStiffness": stiffness,
    "RobotModes": robot_modes,
    "Study": study,
    "JudgedCell": cell,
    "Surface": surface,
    "Cloud": cloud,
    "PointSet": point_set,
    "TaughtEdge": point_set,
    "Recording": recording,
    "Document": document,
}
