"""How each kind of artefact is drawn: `DRAWN`, by its type's name, in the order of what says most.

A drawing gets the artefact, and beside it what its stage took and what came out with it. None: nothing to be drawn.
"""

from __future__ import annotations

import json
import math

import numpy as np

from scripts.pictures.panels import MOST_DOTS, Curve, Panel, Picture, plan
from workbench.geometry.poses import rotation_from_quaternion
from workbench.pieces import BLUE, GREY, INK, ORANGE, PALE, minus
from workbench.report.planned import layer_colours
from workbench.robot.cell import ON_TURNTABLE
from workbench.robot.collision import standing_poses
from workbench.units import DEG

ALONG, ARC = "arc length along the lower edge, mm", "arc length, mm"
JOINTS = [f"joint {k}" for k in range(1, 7)]
WITH_U = "with U = 2 u"
SLICE_MM, BESIDE_MM = 1.5, 6.0  # half a section's thickness; what is drawn of it beside a joint's corners
ARCS, SIZES, LINES, MOST_NAMED, LONG = 5, 4, 4, 6, 17  # drawn of a sphere, a joint, a map; layers; letters of a label
DIVERGING = ("#053061", "#4393c3", "#f4a582", "#b2182b")
LARGE_MM = 3_000.0  # a cell's floor and walls


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
    slices = [(name, at[np.abs(at[:, axis] - middle[axis]) < SLICE_MM / 4.0], colour) for name, at, colour in clouds]
    return plan("A scan as recorded and as registered, on the reference: a slice across the part", *slices)


def deviations(made, beside):
    s, across, d = np.array([made.arc_length_mm, made.across_mm, made.distance_mm])[:, ::2]  # each colour is an image
    steps = np.linspace(*np.nanpercentile(d, (2, 98)), len(DIVERGING) + 1)[1:-1]
    shade = np.where(np.isfinite(d), np.digitize(d, steps), -1)
    names = [minus(f"< {step:.3f}") for step in steps] + [minus(f"> {steps[-1]:.3f} mm")]
    curves = [
        Curve(s[shade == k], across[shade == k], name, how="dots", colour=DIVERGING[k])
        for k, name in enumerate(names)
        if (shade == k).any()
    ]
    return rows("Map of the scan's distances from the reference", ARC, ("across the surface, mm", curves))


# Edges and joints.


def milled_edge(made, beside):
    s = made.arc_length_mm
    root = Curve(s, made.root.value, u=2 * made.root.u)
    bevel = Curve(s, made.bevel.value, u=2 * made.bevel.u)
    words = f"Root face and bevel angle along the edge, {WITH_U} as bands"
    return rows(words, ALONG, ("root face, mm", [root]), ("bevel angle, °", [bevel]))


def raw_edge(made, beside):
    up = np.einsum("ij,ij->i", made.upper_position_mm - made.position_mm, made.across)
    ends = made.position_mm[np.isfinite(made.position_mm).all(axis=1)][[0, -1]]
    way = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = made.position_mm - ends[0]
    off = np.einsum("ij,ij->i", off - (off @ way)[:, None] * way, made.normal)
    return rows(
        f"How far the upper edge lies above the lower one, and the lower one's course {WITH_U}",
        ALONG,
        ("upper above lower\nedge, mm", [Curve(made.arc_length_mm, up)]),
        ("lower edge off a\nstraight line, mm", [Curve(made.arc_length_mm, off, u=2 * made.position_u_mm[:, 0])]),
    )


def joint(made, beside):
    scan, k = first(beside, "Cloud"), int(np.flatnonzero(made.seen)[made.seen.sum() // 2])
    at = np.array([one.section_mm[k] for one in made.corners.values()])
    curves = [Curve(*at.T, "corners", how="marks", colour=ORANGE)]
    if scan:
        near = np.abs(made.frame_arc_length_mm - made.arc_length_mm[k]) < SLICE_MM
        points = scan.placed(*np.nonzero(scan.keep & near[:, None])) - made.origin_mm[k]
        uv = points @ np.array([made.normal[k], made.across[k]]).T
        uv = uv[((uv > at.min(axis=0) - BESIDE_MM) & (uv < at.max(axis=0) + BESIDE_MM)).all(axis=1)]
        curves.insert(0, Curve(*uv.T, "returns", how="dots", colour=GREY))
    words = f"Section of the {type(made).__name__.lower()} at {made.arc_length_mm[k]:.0f} mm, with the corners found"
    return Picture(words, [Panel("along the section's normal, mm", "up, mm", curves, equal=True)])


def joint_inspection(made, beside):
    s, panels = [one.arc_length_mm for one in made.sections], []
    for one in made.characteristics[:SIZES]:
        value, u = one.quantity.value, one.quantity.u
        unit = "°" if one.is_angle else "mm"
        levels = [(f"limit {level:g} {unit}", level) for level in one.limits or ()]
        label = f"{one.term},{' ' if len(one.term) < LONG else chr(10)}{unit}"
        panels.append((label, [Curve(s, value, u=2 * u, how="marks")], levels))
    return rows(f"The first sizes of the joint in its sections, {WITH_U}", ARC, *panels)


def inspection(made, beside, spans=()):
    p, r = made.profile, made.requirements
    panels = []
    for name, unit, label in (("root", "mm", "root face, mm"), ("bevel", "deg", "bevel angle, °")):
        along, seen = (
            getattr(p, f"{name}_{unit}"),
            [s for s in made.sections if getattr(s, f"{name}_{unit}") is not None],
        )
        value, u = (np.array([getattr(s, key) for s in seen]) for key in (f"{name}_{unit}", f"{name}_u_{unit}"))
        marks = Curve([s.arc_length_mm for s in seen], value, u=2 * u, how="marks", colour=INK)
        band = Curve(p.arc_length_mm, along, u=2 * getattr(p, f"{name}_u_{unit}"))
        ends = getattr(r, f"{name}_nominal_{unit}") + np.array(getattr(r, f"{name}_tolerance_{unit}"))
        panels.append((label, [band, marks], [(f"limit {level:g}", level) for level in ends], spans))
    return rows(
        f"Root face and bevel angle along the edge and in the sections, {WITH_U}, and the limits", ALONG, *panels
    )


def study(made, beside):
    name, shift = next(iter(made.measured)), np.linspace(-0.2, 0.2, len(made.operators))
    mean, place = np.nanmean(made.measured[name], axis=3), np.repeat(np.arange(len(made.parts)), made.trials)
    curves = [
        Curve(mean[:, k].ravel(), place + shift[k], f"operator {who}", how="marks")
        for k, who in enumerate(made.operators)
    ]
    label = f"{name.replace('_', ' ').removesuffix(' ' + made.unit_of(name))}, {made.unit_of(name)}"
    return named("Each trial's mean over the sections, by part and operator", label, made.parts, *curves)


# Paths.


def toolpath(made, beside):
    """Layers in the plane square to the feed, laid as docs/conventions.md has it: origin at the root face's foot."""
    final, shown = made.layers[-1], []
    k = int(np.flatnonzero(final.cutting)[final.cutting.sum() // 2])
    x, _, z = rotation_from_quaternion(final.quaternion_wxyz[k : k + 1])[0].T
    out, down = np.array([[math.cos(b := made.bevel_deg * DEG), math.sin(b)], [math.sin(b), -math.cos(b)]])
    for layer in made.layers:
        j = int(np.argmin(np.abs(layer.arc_length_mm - final.arc_length_mm[k])))
        off = made.face_middle_mm(layer)[j] - made.face_middle_mm(final)[k]
        middle = np.array([0.0, made.root_mm]) - (off @ x) * out + (off @ z - final.width_mm[k] / 2.0) * down
        shown.append((layer.index, *np.array([middle + end * layer.width_mm[j] * down for end in (-0.5, 0.5)]).T))
    section = [*by_layer(shown), Curve([0.0, 0.0], [0.0, made.root_mm], colour=INK)]
    feed = Panel(ALONG, "feed, mm/s", [Curve(final.arc_length_mm, final.feed_mm_s)], [("", 0.0)])
    words = f"Layers of the path across the feed ({len(shown)}), above the root face; the feed along the last one"
    return Picture(words, [Panel("out of the root face, mm", "up, mm", section, equal=True), feed])


def rework(made, beside):
    spans = [(one.from_mm, one.to_mm) for one in made.too_much_material]
    found = inspection(first(beside, "Inspection"), beside, spans)
    return Picture("Root face and bevel angle of the inspection; shaded: what is to be milled again", found.panels)


def correction(made, beside):
    s, u, turn_u = made.arc_length_mm, 2 * made.displacement_u_mm, 2 * made.turn_u / DEG
    shift = [Curve(s, made.displacement_mm, "displacement", u), Curve(s, made.shift_mm, "correction")]
    turn = [Curve(s, made.turn / DEG, u=turn_u), Curve(s, made.tilt / DEG)]
    words = f"How far the first cut lies off its plan, {WITH_U}, and the correction of the next pass"
    return rows(words, ALONG, ("along the bevel's\nnormal, mm", shift), ("about the feed, °", turn))


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


def workpiece(made, beside):
    part = made.recipe.part
    t, root, bevel = ((one.start + one.end) / 2.0 for one in (part.thickness_mm, part.root_mm, part.bevel_deg))
    lean = math.tan(part.end_face_tilt_deg * DEG)
    milled = [(lean * root, root), (lean * root - (t - root) * math.tan(bevel * DEG), t)]
    outline = [(-3.0 * t, 0.0), (0.0, 0.0), *([(lean * t, t)] if part.kind == "raw" else milled), (-3.0 * t, t)]
    words = f"Section of the {part.kind} part of the recipe, {part.length_mm:g} mm long and {t:g} mm thick on average"
    panel = Panel("out of the end face, mm", "up, mm", [Curve(*np.array(outline).T, colour=INK)], equal=True)
    return Picture(words, [panel])


# Calibration.


def sphere_profiles(made, beside):
    scan, turn, gap = first(beside, "Recording"), np.linspace(0.0, 2 * np.pi, 120), [[np.nan, np.nan]]
    some = np.linspace(0, len(made.frame) - 1, ARCS).astype(int)
    at, on = made.circle[some], made.on_arc[made.frame[some]]
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = np.vstack([np.vstack([(x, z) + math.sqrt(w) * ring, gap]) for x, z, w in at])
    returns = scan.x_mm[made.frame[some]][on], scan.z_mm[made.frame[some]][on]
    curves = [
        Curve(*rings.T, "circles", colour=GREY),
        Curve(*returns, "returns", how="dots", colour=BLUE),
        Curve(*at[:, :2].T, "centres", how="marks", colour=ORANGE),
    ]
    words = f"Circles through the returns from the sphere, in {ARCS} of {len(made.frame)} frames"
    return Picture(words, [Panel("x, lateral, mm", "z, range, mm", curves, equal=True)])


def calibration(made, beside):
    names, k = postures_of(made)
    off = made.center_base_mm - made.sphere_center_mm
    residual = [Curve(made.residual[:, c], k, axis, how="marks") for c, axis in enumerate("xz")]
    centre = [Curve(off[:, c], k, axis, how="marks") for c, axis in enumerate("xyz")]
    panels = [
        Panel("residual of the circle's centre, mm", "", residual, names=names),
        Panel("the sphere's centre in the base, off the answer, mm", "", centre, names=names),
    ]
    return Picture("What the calibration leaves of the sphere's centre in each posture, in profile and base", panels)


def validation(made, beside):
    names, k = postures_of(made)
    curves = [
        Curve(made.error_mm[:, c], k + off, axis, 2 * made.u_mm[:, c], "marks")
        for c, axis, off in ((0, "x", -0.15), (2, "z", 0.15))
    ]
    words = f"Errors of the predicted sphere centre in postures that were left out, {WITH_U}"
    return named(words, "error in the profile, mm", names, *curves)


def postures_of(made):
    return [f"posture {k}" for k in range(1, len(made.frames) + 1)], np.arange(len(made.frames))


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
    if found.get("format") == "bevel-sensitivity":
        size = found["characteristics"][0]
        words = f"What each link adds to the uncertainty of the {size['name']}"
        links = size["links"]
        return bars(words, f"u, {size['unit']}", [one["name"] for one in links], [one["u"] for one in links])
    return None


# Robot.


def cell(made, beside):
    from scipy.spatial import ConvexHull

    curves, standing = [], standing_poses(made, 0.0)
    for shape in made.shapes:
        pose = (standing[shape.link - ON_TURNTABLE] if shape.link >= ON_TURNTABLE else np.eye(4)) @ shape.pose
        seen = (outline(shape) @ pose[:3, :3].T + pose[:3, 3])[:, [0, 2]]
        ring = np.append(hull := ConvexHull(seen).vertices, hull[0])
        if np.ptp(seen, axis=0).max() < LARGE_MM:
            colour = BLUE if 1 <= shape.link <= 6 else GREY
            curves.append(Curve(*seen[ring].T, colour=colour))
    axes = np.vstack([made.chain.points_mm, made.chain.base_from_flange_at_zero[:3, 3]])
    curves.append(Curve(axes[:, 0], axes[:, 2], "points on the joints' axes", how="marks", colour=ORANGE))
    words = "The cell from the side, all joints at 0: outlines of its shapes, those of the robot in blue"
    return Picture(words, [Panel("x of the base, mm", "z, mm", curves, equal=True)])


def outline(shape):
    """Points (k, 3) whose hull is about the shape's."""
    if shape.vertices_mm is not None:
        return shape.vertices_mm
    if shape.kind == "box":
        return np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1).T * shape.size_mm
    turn, up = np.meshgrid(np.linspace(0, 2 * np.pi, 24), np.linspace(-np.pi / 2, np.pi / 2, 13))
    round_end = 0.0 if shape.kind == "cylinder" else 1.0
    ball = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), round_end * np.sin(up)], axis=-1)
    half = np.array([0.0, 0.0, shape.size_mm[1] / 2.0 if len(shape.size_mm) > 1 else 0.0])
    return np.vstack([shape.size_mm[0] * ball.reshape(-1, 3) + end * half for end in (-1, 1)])


def stiffness(made, beside):
    words, u = f"Stiffness of each joint, {WITH_U}", 2e-6 * made.u_nm_per_rad
    return bars(words, "stiffness, MNm/rad", JOINTS, 1e-6 * made.nm_per_rad, u)


def robot_modes(made, beside):
    words, u = "Mass of each link, the tool on the sixth, with U = 2 u", np.sqrt(np.diag(made.covariance))[6:12]
    names = [f"link {k}" for k in range(1, 7)]
    return bars(words, "mass, kg", names, made.bodies.mass_kg, 2 * u * made.bodies.mass_kg)


def stability(made, beside):
    limits = [Curve(made.at, one, name) for one, name in ((made.up_limit_mm, "up"), (made.down_limit_mm, "down"))]
    depth = Curve(made.at, made.depth_mm, "depth of cut")
    return rows("Limiting depth along the path, and the depth", "point of the path", ("depth, mm", [*limits, depth]))


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


def maps(made, beside):
    (a, b), (one, other) = made.at, made.axes
    curves = [
        Curve(b / DEG, made.fp[k], minus(f"axis {one} at {a[k] / DEG:.0f}°"))
        for k in np.linspace(0, len(a) - 1, LINES).astype(int)
    ]
    return rows("The weight of K_c in the displacement, over two axes", f"axis {other}, °", ("f_p, a ratio", curves))


DRAWN = {
    "Rework": rework,
    "PathCorrection": correction,
    "Engagement": engagement,
    "Moves": moves,
    "Deviations": deviations,
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
    "StiffnessMaps": maps,
    "LoadPlan": load_plan,
    "PathDeflection": path_deflection,
    "Postures": postures,
    "MillingForce": force,
    "Deflection": deflection,
    "Toolpath": toolpath,
    "RawEdge": raw_edge,
    "JointStiffness": stiffness,
    "RobotModes": robot_modes,
    "PathStability": stability,
    "Study": study,
    "JudgedCell": cell,
    "Surface": surface,
    "Cloud": cloud,
    "PointSet": point_set,
    "TaughtEdge": point_set,
    "Recording": recording,
    "Workpiece": workpiece,
    "Document": document,
}
