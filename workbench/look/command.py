"""`workbench look`: the summary as text, and the view as one page that needs no network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from markupsafe import Markup

from workbench import cad, force_file
from workbench.artefacts import Recording, Scene, Shading, Strokes
from workbench.cloud import readers
from workbench.cloud.read_stage import LEAST_POINTS, check_size, fitting_units, in_process, unit_stated
from workbench.cloud.units import MM
from workbench.errors import InputError, OutputError, one_line
from workbench.importing import arrays, tracker
from workbench.importing.draft import drafted
from workbench.importing.kinds import check_file, read_source
from workbench.importing.mapping import Mapping, mapping_of, no_mapping, read_mapping
from workbench.importing.roles import leading
from workbench.importing.text import first_bytes, form_of, head_text, read_text
from workbench.look.content import (
    MOST_POINTS,
    FileContent,
    Profile,
    Shade,
    box,
    check_lines,
    chosen_of,
    failed,
    limit_text,
    shades_of,
)
from workbench.look.foreign import frames_alone, joints_alone, numbers_alone, poses_alone, tracker_alone
from workbench.look.recorded import recording_content, unchecked
from workbench.look.rows import groove_of_rows
from workbench.look.seven_corners import read_corners, recognised
from workbench.scan.read_stage import read as read_recording
from workbench.storage import write_whole


def look(
    file: str | Path,
    out: str | Path | None = None,
    mapping: str | Path | None = None,
    corners: str | Path | None = None,
) -> tuple[str, ...]:
    """What a file holds, as lines; and as a page in `out` if that is named.

    Args:
        file: a recording, a cloud, or anything that `workbench import` reads.
        out: the page to write, `.html`, complete in itself.
        mapping: MAP.json, where the file does not explain itself.
        corners: a table to write, `.csv`: the corners of a groove in every row of ranges.

    Raises:
        InputError: the file cannot be read.
        OutputError: the page cannot be written, or would replace a file that is no such page.
    """
    found = content_of(Path(file), None if mapping is None else Path(mapping))
    if out is not None:
        write_page(found, Path(out))
    if corners is not None:
        write_corners(found, Path(corners))
    return summary(found)


def write_corners(found: FileContent, target: Path) -> None:
    """Column with its standard uncertainty, and range, of each corner in each row; empty where it is not told."""
    if found.corners is None:
        raise InputError(found.source, "expected rows of ranges across a groove, for --corners")
    if target.suffix.lower() != ".csv":
        raise InputError(str(target), "expected the name of a table to write, ending in .csv")
    columns = {"column": found.corners.column, "column_u": found.corners.column_u, "range": found.corners.z}
    names = [f"{name}_{what}" for what, of in columns.items() for name in of]
    table = np.stack([row for of in columns.values() for row in of.values()], axis=1)
    lines = [",".join(["row", *names])]
    for number, row in enumerate(table):
        lines.append(",".join([str(number), *("" if np.isnan(v) else f"{v:.2f}" for v in row)]))
    _check_own(target, lines[0].encode())
    write_whole(target, "\r\n".join([*lines, ""]).encode())


def summary(found: FileContent) -> tuple[str, ...]:
    """The file in lines: what it is, what is in it, what the checks say, what to try."""
    lines = [f"{found.source}: {found.kind}, shown in {found.frame}", *found.lines]
    if found.checks:
        bad = sum(not check.passed for check in found.checks)
        lines += [f"checks: {len(found.checks) - bad} passed, {bad} failed", *check_lines(found.checks)]
    if found.suggestions:
        lines += ["conventions that would make this consistent:", *(f"  {one}" for one in found.suggestions)]
    return tuple(one_line(line) for line in [*lines, *(f"note: {hint}" for hint in found.hints)])


def write_page(found: FileContent, target: Path) -> None:
    """The page, whole or not at all."""
    if target.suffix.lower() not in (".html", ".htm"):
        raise InputError(str(target), "expected the name of a page to write, ending in .html")
    _check_own(target, PAGE)
    write_whole(target, page(found).encode())


def _check_own(target: Path, begins: bytes) -> None:
    """Refuse to replace a file that `look` has not written: one without these bytes near its beginning."""
    if target.is_file() and begins not in first_bytes(target):
        raise OutputError(str(target), "was not written by `workbench look`, and would be lost; choose another name")


# Any file to what is seen in it: recordings, clouds, other people's profiles and poses.

PAGE = b"<title>Look: "  # what tells a page of `look` from others
RECORDINGS = (".h5", ".hdf5")
TEXTS = (".csv", ".txt", ".asc")  # may be a cloud, or anything


def content_of(file: Path, mapping: Path | None = None) -> FileContent:
    """What the file holds.

    Raises:
        InputError: it is no recording, no cloud and nothing that `workbench import` reads, or too damaged.
    """
    chosen = no_mapping() if mapping is None else read_mapping(mapping)
    suffix = file.suffix.lower()
    check_file(file)
    if suffix in RECORDINGS:
        return _recording(file)
    if suffix in cad.SUFFIXES:
        return _model(file)
    if suffix in readers.READERS and suffix not in TEXTS:
        return _cloud(file)
    if (other := _other(file)) is not None:
        return other
    ways: list[Callable[[Path], FileContent]] = [partial(_foreign, mapping=chosen)]
    if mapping is None and suffix == arrays.ENDING:
        ways = [_drafted]  # numbers alone: their units are drafted
    elif mapping is None and not tracker.recognises(file, first_bytes(file), chosen):
        ways += [_drafted, *([_cloud_of_text, _numbers] if suffix in TEXTS else [])]
    refused: list[InputError] = []
    for way in ways:
        try:
            return way(file)
        except InputError as error:
            refused.append(error)
    raise refused[0]  # what the file is not says more than what a table of points would need


def _other(file: Path) -> FileContent | None:
    """What is neither profiles nor poses nor points: corners of a groove, forces."""
    head = head_text(first_bytes(file))
    nothing, hint = np.zeros((0, 3)), "it is no recording: nothing of it goes into `workbench import`"
    if force_file.recognises(head):
        lines = tuple(force_file.summary(force_file.read_forces(file)))
        return FileContent(str(file), force_file.NAME, "no frame: forces over time", lines, nothing, (), hints=(hint,))
    if not recognised(head):
        return None
    seven = read_corners(read_text(file), str(file))
    at = seven.corners_mm
    sizes = [
        f"{name}: {value.min():.3f} to {value.max():.3f} mm, median {np.median(value):.3f}"
        for name, value in (
            ("width between the upper edges", np.abs(at[:, 6, 0] - at[:, 0, 0])),
            ("gap between the roots", np.abs(at[:, 5, 0] - at[:, 1, 0])),
            ("depth at the left root", at[:, 0, 2] - at[:, 1, 2]),
            ("depth at the right root", at[:, 6, 2] - at[:, 5, 2]),
            ("misalignment", at[:, 6, 2] - at[:, 0, 2]),
        )
    ]
    count = (
        f"rows: {len(at)}, {int(np.isfinite(seven.torch_mm[:, 0]).sum())} with the torch's place; metres in the file"
    )
    points = at.reshape(-1, 3)
    return FileContent(
        str(file),
        "seven corners of a groove",
        "the tracker's frame",
        (count, *sizes),
        points,
        shades_of(points),
        hints=(hint,),
    )


def _recording(file: Path) -> FileContent:
    """A recording; where `scan.read` would refuse it, as much of it as can be shown, and why."""
    try:
        recording: Recording = read_recording(recording=file)
    except InputError as error:
        return unchecked(file, error)
    return recording_content(recording)


def _model(file: Path) -> FileContent:
    """A CAD model: its bevelled edges by number, and its surface."""
    points, triangles = cad.surface(file)
    if not len(triangles):
        raise InputError(str(file), "expected a solid with faces, found none")
    lines = [f"triangles: {len(triangles)}", f"extent: {box(points)}, by the unit in the file"]
    strokes: tuple[Strokes, ...] = ()
    hints: tuple[str, ...] = ()
    try:
        edges = cad.nominal_edges(file)
    except InputError as error:
        lines.append(f"no bevelled edge: {error.expected}")
    else:
        lines += [f"edge {k}: {one.summary()}" for k, one in enumerate(edges, 1)]
        green = np.array([[0, 158, 115]], np.uint8)
        drawn = tuple(one.points_mm for one in edges)
        strokes = (Strokes("bevelled edges", drawn, tuple(green.repeat(len(one), 0) for one in drawn)),)
        one = edges[0]
        sizes = f"root_nominal_mm={one.root_mm[0]:.4g} --input bevel_nominal_deg={one.bevel_deg[0]:.4g}"
        hints = (
            "to plan its scan: --input edge=FILE --input edge_number=K (docs/scan_planning.md)",
            f"edge 1 as requirements: --input {sizes}",
            'to compare with it: the stage compare.mesh, "mesh": FILE (docs/comparison.md)',
        )
    frame = "the frame of the model"
    return FileContent(
        str(file), "CAD model (STEP)", frame, tuple(lines), points, shades_of(points), strokes=strokes, hints=hints
    )


def _cloud(file: Path) -> FileContent:
    """A cloud without a grid, whatever its size, in its format's unit, else the first under which it may be a part."""
    found = in_process(file)
    found = found[np.isfinite(found).all(axis=1)]
    if not len(found):
        raise InputError(str(file), "expected points, found none")
    stated = unit_stated(file)
    fits = fitting_units(found)
    unit = stated or (fits[0] if fits else "mm")
    others = f"; {' or '.join(fits[1:])} would be possible too" if fits[1:] else ""
    why = ("the format states no unit" if unit == "mm" else "in mm it would be no part") + others
    points = found * MM[unit]
    checks = []
    try:
        check_size(points, unit, str(file))
    except InputError as error:
        checks.append(failed("size_mm", float(np.ptp(points, axis=0).max()), "what a part may measure", error.expected))
    lines = [f"points: {len(points)}, coordinates {f'in {unit}' if stated else f'taken as {unit}: {why}'}"]
    some, more = chosen_of(points), "" if unit in (stated, "mm") else f" --input unit={unit}"
    hint = f"as a cloud: workbench run pipelines/inspect_cloud.json --input cloud=FILE{more} (docs/clouds.md)"
    return FileContent(
        str(file),
        f"cloud without a grid ({file.suffix[1:].upper()})",
        "the frame of the file",
        (*lines, f"extent: {box(points)}"),
        some,
        shades_of(some),
        checks=tuple(checks),
        hints=(hint,),
    )


def _cloud_of_text(file: Path) -> FileContent:
    """A cloud whose points stand in a table; a few rows are something else, unless they are homogeneous coordinates."""
    form = form_of(file)
    found = _cloud(file)
    rows = len(found.points_mm) if form is None else len(form.rows)
    homogeneous = form is not None and form.rows.shape[1] > 3 and bool((form.rows[:, 3] == 1.0).all())
    if rows < LEAST_POINTS and not homogeneous:
        raise InputError(str(file), f"expected a cloud of at least {LEAST_POINTS} points, found {rows} rows")
    if form is not None and not form.header and "time" in leading(form.rows):
        raise InputError(str(file), "its first column is a time: no cloud; name its columns in a mapping")
    beyond = 0 if form is None else form.rows.shape[1] - 3
    more = (f"columns: the first three are taken as x, y, z; {beyond} more are left out",) if beyond > 0 else ()
    return replace(found, lines=found.lines + more)


def _numbers(file: Path) -> FileContent:
    """A table of numbers of another kind."""
    form = form_of(file)
    if form is None:
        raise InputError(str(file), "expected a table of numbers")
    return numbers_alone(form, str(file))


def _drafted(file: Path) -> FileContent:
    """A table as a drafted mapping reads it; what is uncertain is told."""
    tree, _ = drafted([file])
    mapping = mapping_of(tree)
    found = _foreign(file, mapping)
    if tree.get("profiles", {}).get("frames") == "rows":
        found = _with_corners(file, mapping, found)
    doubts = [f"{what}: {text}" for what in ("uncertain", "lacking") for text in tree.get(what, ())]
    return replace(found, hints=(*doubts, *found.hints))


def _with_corners(file: Path, mapping: Mapping, found: FileContent) -> FileContent:
    """Rows of ranges whose unit, pitch and poses are unknown show a groove all the same, in columns."""
    frames = read_source(file, mapping).profiles
    rows = None if frames is None else groove_of_rows(frames.z_mm.astype(float), str(file))
    return found if rows is None else replace(found, lines=(*found.lines, rows.summary), corners=rows)


def _foreign(file: Path, mapping: Mapping) -> FileContent:
    """Profiles or poses of other people's files, in their own frame."""
    found = read_source(file, mapping)
    if found.profiles is not None:
        return frames_alone(found, str(file))
    if found.tracker is not None:
        shown = tracker_alone(found.tracker, str(file))
        if found.joints is None:
            return shown
        joints = joints_alone(found.joints, (), str(file))
        return replace(shown, kind=f"{joints.kind}, and {shown.kind}", lines=(*joints.lines, *shown.lines))
    if found.poses is None and found.joints is not None:
        return joints_alone(found.joints, found.notes, str(file))
    return poses_alone(found, str(file))


def profile_drawing(profile: Profile) -> bytes:
    """SVG of a profile: its points, the lines through them, the corners by number; x and z each to their own scale."""
    from workbench.marks import LIMIT, MEASURED, REJECTED
    from workbench.plot import Figure

    figure = Figure(figsize=(10.0, 3.8))
    axes = figure.add_axes((0.07, 0.13, 0.91, 0.84))
    axes.points(profile.x_mm, profile.z_mm, ".", color=LIMIT, markersize=3.0)
    for line in profile.lines:
        ends = np.array(line.x_mm)
        axes.plot(ends, line.slope * ends + line.offset_mm, color=MEASURED)
    for number, corner in enumerate(profile.corners, 1):
        axes.points([corner.x_mm], [corner.z_mm], "o", color=REJECTED)
        axes.annotate(str(number), (corner.x_mm, corner.z_mm), (6, 6))
    axes.set(xlabel="x, mm", ylabel="z, mm")
    return figure.svg()


SHARE = (1.0, 99.0)  # per cent of the values that the ramp spans; strays do not wash it out


def page(found: FileContent) -> str:
    """The whole page."""
    from workbench.report.html_stage import packed, policy, viewer_script
    from workbench.report.text import data_address, source
    from workbench.templates import environment

    viewer = viewer_script()
    scene = scene_of(found)
    return (
        environment("workbench.look")
        .get_template("look.html.j2")
        .render(
            found=found,
            name=Path(found.source).name,
            lines=summary(found)[1:],
            limit_text=limit_text,
            style=source("page.css"),
            viewer=viewer,
            policy=policy(viewer),
            scene=Markup(packed(scene, MOST_POINTS)) if scene is not None else "",
            drawing=data_address(profile_drawing(found.profile))
            if found.profile is not None and len(found.profile.x_mm)
            else "",
        )
    )


def scene_of(found: FileContent) -> Scene | None:
    """What is turned in the browser; None where there is nothing."""
    seen_alone = len(found.points_mm) > 0  # then the points fill the first view; robot and axes can be shown
    strokes = tuple(replace(one, shown=one.shown and not seen_alone) for one in found.strokes if one.lines_mm)
    if not len(found.points_mm) and not strokes:
        return None
    shadings = tuple(_shading(shade) for shade in found.shades) if len(found.points_mm) else ()
    return Scene(found.points_mm, shadings, strokes, (), np.eye(3), axes_names=("x", "y", "z"))


def _shading(shade: Shade) -> Shading:
    from workbench.marks import ramp

    low, high = np.percentile(shade.values, SHARE)
    if not high > low:
        low, high = float(shade.values.min()), float(shade.values.max())
    palette = ramp(np.linspace(0.0, 1.0, 256))
    index = np.round(255.0 * np.clip((shade.values - low) / max(high - low, 1e-12), 0.0, 1.0)).astype(np.uint8)
    legend = tuple(
        (f"{low + part * (high - low):.6g}", "#{:02x}{:02x}{:02x}".format(*palette[round(255 * part)]))
        for part in (0.0, 0.25, 0.5, 0.75, 1.0)
    )
    return Shading(shade.name, index, palette, legend)
