"""The limits of all checks: one table, from which checks, refusals and docs/tables/checks.csv are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, TypeAlias

from pydantic import AfterValidator

from workbench.artefacts import Check
from workbench.errors import nearest

Bound = float | tuple[float, float]


@dataclass(frozen=True, slots=True)
class Limit:
    """What a check asks for, and why."""

    bound: Bound  # greatest allowed value, or least and greatest
    meaning: str
    reason: str


LIMITS: dict[str, Limit] = {
    "view_width_mm": Limit(
        (6.0, 3000.0),
        "width of the profiles, lost columns among them; 0.5 mm is enough where frames are under 25 columns apart",
        "profilers for edges see 7 mm to 3 m; frames are rarely closer than columns, so in inches they seem far apart",
    ),
    "uneven_share": Limit(
        0.1,
        "share of the columns that are unevenly spaced, where ranges are evenly spaced",
        "a sensor's pixels are even and ranges have noise: of 331 recordings none has even ranges",
    ),
    "range_mm": Limit(10_000.0, "greatest distance of a return along z", "no triangulating profiler sees further"),
    "reach_mm": Limit(
        (250.0, 30_000.0),
        "greatest distance of the flange from the robot's base",
        "less is inside the robot, more needs a track of 30 m; a linear axis goes 2 mm to 100 m",
    ),
    "standing_share": Limit(
        0.5,
        "share of the frames of a pass during which the recorded pose stands still",
        "a robot that waits does so for less of a scan; a pose stream that hangs looks like this",
    ),
    "held_poses": Limit(
        8.0,
        "count of poses in a row with one position, or one orientation, to the last digit before a jump to the next",
        "a robot that waits goes on without a jump; a pose stream that hangs makes up for it at once",
    ),
    "position_jump_mm": Limit(
        0.5,
        "single jump of a recorded position, against the motion before and after it",
        "robots move smoothly; a jump displaces all that follows, which bends a curved edge",
    ),
    "orientation_step_deg": Limit(
        0.1,
        "standard uncertainty of a rotation by the digits to which quaternions are rounded",
        "two digits leave 0.6 deg, as much in all poses of a robot that hardly rotates; three leave 0.06",
    ),
    "hand_eye_mm": Limit(
        (5.0, 2000.0),
        "distance of the profiler's origin from the flange; 0: the poses are the profiler's own",
        "a bracket and a sensor have sizes; less is a translation in metres",
    ),
    "repeated_run": Limit(
        4.0,
        "number of consecutive frames that repeat the one before them bit for bit",
        "drivers read a frame up to five times, and the first counts; ten that come late at the start of a ring put "
        "its root face 0.04 mm off",
    ),
    "one_sensor": Limit(
        0.003,
        "change of the scale of x between neighbouring frames, where it is a single one; 2: x is mirrored",
        "a column of a sensor measures along one ray; good recordings of four simulators have up to 0.00001",
    ),
    "mirrored_frames": Limit(
        0.0,
        "count of the places in a pass from which on profiles lie on those before in a mirror alone",
        "a sensor's columns keep their order",
    ),
    "frames_vary": Limit(
        (0.05, 1.0),
        "how much mean, slope, median and least range and mean place of frames vary from one to the next, "
        "over what noise makes of them; the least of these, 1 at most",
        "good recordings have 0.7 and more; frames zeroed or levelled one by one have 0.00, and lie elsewhere",
    ),
    "mean_columns": Limit(
        3.1,
        "width of a moving mean over the columns of a profile",
        "a mean moves the edge of a face by up to half its width, which is in the uncertainty of the face's end; one "
        "over more columns, or a Gaussian of 0.9, leaves too little of narrow faces; not asked of spheres",
    ),
    "held_end_share": Limit(
        0.18,
        "share of the short gaps, filled ones among them, whose ranges hold the one beside them, or continue its "
        "slope, to the digit and more often than noise does",
        "a median, or a filter that fills lost returns, comes to 0.25 and more; good recordings have 0.00, one in "
        "hundreds up to 0.13",
    ),
    "range_step_mm": Limit(
        0.3,
        "step to which ranges are rounded",
        "to 0.1 mm faces are measured within u; no face is found in coarser steps than a third of a millimetre",
    ),
    "lateral_step_mm": Limit(
        0.02,
        "step to which lateral places are rounded, where they are uneven for it",
        "it moves returns along the faces; a quarter of the columns' distance is taken where that is more",
    ),
    "obliquity_deg": Limit(
        27.0,
        "angle between the laser plane's normal and the edge, from poses and profiles together",
        "scans are made at 0 to 25 deg; wrong orientations or hand-eye poses mostly give 27 to 68 deg",
    ),
    "obliquity_varies_deg": Limit(
        8.0,
        "how much that angle varies within a pass, to each side of its middle, or what is slow of it where that is "
        "less; 3 where another reading leaves less than 0.4 of it, and of how much the edge turns against the plane; "
        "0.5 where a mirrored axis of the profiles leaves less than 0.2",
        "scans of rings, saddles, swaying robots and through taught points vary by 1 to 3, of wavy edges by up to 6 "
        "under any reading; wrong orientations or axes along a curved edge by 5 to 40",
    ),
    "twist_deg": Limit(
        35.0,
        "rotation of the section about the edge over 150 mm of it that the orientations do not explain; 0.25 where "
        "another reading of them explains most of it, below 1.2 deg only if that also halves an obliquity of at least "
        "10 deg",
        "edges of helices and saddles turn by up to 30; none happens to be twisted as a known mistake would show it",
    ),
    "unsteady_twist_deg": Limit(
        3.0,
        "the same, less its slow variation along the edge and what waves of the edge do under an oblique laser plane",
        "plates twist slowly, good recordings have up to 0.5; wrong orientations rotate the section with the wrist",
    ),
    "together_share": Limit(
        (0.6, 1.0),
        "share of neighbouring profiles, some frames apart, that lie on each other; of the worst pass that has seven",
        "good recordings have 0.73 and more, the least with clamps in view; frames out of order have half of it, and "
        "no other check can follow the edge through them",
    ),
    "wiggle_mm": Limit(
        0.1,
        "standard deviation by which the section's place in the view jumps from frame to frame",
        "robots that scan vibrate by less, and a rough face shows neighbouring frames nearly one place; frames out of "
        "order jump by what the place varies over the pass",
    ),
    "pose_noise_mm": Limit(
        0.12,
        "standard deviation by which the recorded poses jump across the edge's way, from profile to profile",
        "robots are smoother, and a path that is planned from such poses is off by as much",
    ),
    "pass_disagreement_mm": Limit(
        0.6,
        "distance of a face as one pass saw it from where the next saw it",
        "robots repeat to 0.1 mm and calibrated hand-eye poses add 0.3 mm",
    ),
    "found_share": Limit(
        (0.34, 1.0),
        "share of the frames that show something in which the faces of the edge, the groove or the preparation were "
        "found",
        "they are there all along a plate",
    ),
    "agreement": Limit(
        (0.6, 1.0),
        "share of those, and of profiles with a face that is not to be read, that show the kind of face, or the "
        "preparation, that most do; of the worse plate",
        "a plate is prepared in the same way along its edge; spatter and tack welds hide less, U and J grooves leave "
        "up to 0.3 unread; what the lesser part of the profiles shows is mostly the upper one of two faces",
    ),
    "root_seen_share": Limit(
        (0.34, 1.0),
        "share of the frames with faces in which the root face ends by itself, not at the end of the view",
        "without its end a bevel face under the upper surface looks like a root face under a bevel face",
    ),
    "late_turn_deg": Limit(
        0.03,
        "turn of a raw edge's face that goes with how fast the scanner turns, root mean square, where that is certain",
        "poses that come 5 ms late at 3 deg of sway make as much; certain is what exceeds twice its uncertainty; a "
        "smaller one is in the uncertainty, and so is one that the face's place alone shows, or that 10 ms "
        "would make unseen",
    ),
    "edge_break_mm": Limit(
        1.6,
        "radius of the rounded, or height of the chamfered lower edge that the returns show; of a raw edge of both",
        "up to 2 mm are fitted; what is larger is a bevel, or a face of its own",
    ),
    "root_columns": Limit(
        (5.0, 1e5),
        "columns that the expected root face's width would hold",
        "a face of fewer columns is not found, and its neighbours are taken for it",
    ),
    "root_over_nominal": Limit(
        (0.25, 3.5),
        "width of what would be the root face over its nominal size; 2.3 at most where no upper surface is in view, "
        "0.5 at least where neither it nor the lower surface is",
        "the nominal size distinguishes the faces; where upper surface and bevel face are all that the view shows, "
        "they look like a bevel face and a wide root face, and a bevel face like a narrow one",
    ),
    "complement_nearer_deg": Limit(
        5.0,
        "by how much nearer to the nominal bevel angle the complement of the measured one comes, where neither upper "
        "nor lower surface is in view",
        "upper surface and bevel face meet at that complement: where the root face is out of view, they look like "
        "bevel face and root face; a bevel within 5 deg of its nominal angle passes",
    ),
    "readings_apart": Limit(
        (0.25, 1e5),
        "by how much root face and bevel face, read the other way round, fit worse, where neither upper nor lower "
        "surface is in view, or two plates are: half the square of the logarithm of a width over its nominal one, in "
        "units of 0.6",
        "faces of the same width cannot be distinguished; 0.25 is a bevel face 1.5 times as wide as the nominal "
        "root face",
    ),
    "face_bow": Limit(
        0.3,
        "bow of a face, where it is certain, over that of a chord which makes the flatter corner beside it by itself",
        "faces of good recordings bow by up to 0.14 of it, which is in u; chords of domes, bars and cables by all of "
        "it, a rounded corner's end by half",
    ),
    "face_bend_deg": Limit(
        1.0,
        "turn of a corner within the root face or the bevel face, where two straight pieces fit its returns for "
        "certain and a bow does not",
        "no face of 900 good ones of three simulators shows one, bowed ones and those with ghosts included; of "
        "compound bevels that differ by 1.5 deg and more nine in ten do; a smaller one is in the uncertainty",
    ),
    "step_share": Limit(
        0.3,
        "share of some frames in which returns run parallel to the root face, or the end face of a raw plate, 0.04 to "
        "3 mm beside it, beyond an end of it",
        "good root faces have 0, raw plates up to 0.15; a lower part that stands back by 0.05 mm and more has 0.5 to "
        "1, where the rays reach it",
    ),
    "goes_on_share": Limit(
        0.3,
        "share of the frames in which a surface that is none of the plate's follows a face: beyond the root face 2 deg "
        "and more off it or turned up again, beyond a raw edge's end face by less than a right angle",
        "plates are convex and show none; the lower bevel of a double one is seen in 0.55 to all of the frames",
    ),
    "end_step_columns": Limit(
        4.0,
        "step in columns at which alone a root face or an end face ends, where it ends in three and more",
        "faces end in any column; a window that follows the part moves by 8, 16 or 32 and may cut it",
    ),
    "face_columns": Limit(
        (8.0, 1e5),
        "of a prepared plate or a groove, returns of a profile on its narrowest face, clear of the corners",
        "fewer do not show whether it is straight: a rounded corner passes for a face",
    ),
    "corner_stands_out_mm": Limit(
        0.01,
        "how far returns within 0.25 mm of the corner of root face and bevel face stand out of both on average, beyond "
        "what noise and bow explain; median of the frames",
        "good recordings have less than 0.003; a ledge of 0.1 mm, which takes 0.1 to 0.2 mm off the root face, has up "
        "to 0.02; "
        "smaller ones are in the uncertainty",
    ),
    "end_face_lean_deg": Limit(
        25.0,
        "angle between the end face of a raw edge and upper_side, in the laser plane",
        "upper_side is good to that much; a bevel leans by 25 to 55 deg",
    ),
    "face_behind_share": Limit(
        0.3,
        "share of some frames in which a second face rises behind the end face of a raw edge, along it, where the "
        "surface that joins its upper end ends",
        "plates show none, clamps on them some; the end face of a strip below a plate was taken for the plate's, 7 mm "
        "off",
    ),
    "two_plates_share": Limit(
        0.4,
        "share of some profiles in which two level plates with a groove between them were found, of a single edge that "
        "shows no other surface",
        "grooves show them in 0.9 and more, edges beside a table in less than 0.1; beside a rail as high as the plate "
        "in all: there its upper surface identifies the one edge with a root face and a bevel",
    ),
    "groove_compound": Limit(
        0.2,
        "share of the profiles in which a plate of a groove shows a face above a steeper one",
        "plain grooves come to 0.05 among spatter and tack welds; bevels of two angles mostly to 0.4 and more, and "
        "what the other profiles showed of these was measured as one",
    ),
    "root_extent_mm": Limit(
        (-0.1, 1.0),
        "of a prepared plate, width of the root face by its corners less what its returns, clear of them, take up",
        "good recordings have 0.15 to 0.5; faces that are no neighbours cross elsewhere",
    ),
    "fillet_misfit_mm": Limit(
        0.006,
        "how far flank and fillet of a J preparation stand off line and circle in the same way in all profiles, rms",
        "fillets of both simulators leave up to 0.0011; straight faces and bowed flanks taken for them 0.01 and more",
    ),
    "land_tilt_deg": Limit(
        8.0,
        "angle between the land below a fillet and the upper surface",
        "as of a nose's land; what falls more is a bevel below another one",
    ),
    "groove_gap_mm": Limit(
        (-0.2, 15.0),
        "gap between the plates of a groove; below 0: by how much their roots overlap for certain",
        "plates are joined at gaps of up to 10 mm; what lies beside two narrow plates is further apart, and no plate "
        "lies in another",
    ),
    "bevel_grazing": Limit(
        8.0,
        "step of the columns along a bevel of a groove over that along its plate",
        "the view stands at less than 7 deg to it: where returns end is then where the view grazes the face",
    ),
    "root_face_lean_deg": Limit(
        5.0,
        "angle between what is taken for the root face of a groove and the square to its plate; median of the profiles",
        "root faces of both simulators lean by up to 0.9; the lower face of a compound bevel by 10 and more, and the "
        "gap was up to 6 mm off",
    ),
    "fillet_misfit": Limit(
        6.0,
        "nine tenths of a fillet's returns lie within how many times their noise of its circle; median of the profiles",
        "fillets of both simulators come to 4.5; a bevel on a backing strip, taken for a J, to 35",
    ),
    "root_levels": Limit(
        0.5,
        "difference between the depths below their plates at which the two roots begin, over the greater one",
        "plates with the same preparation differ by up to 0.1; of a bevel of two angles, whose lower face the view "
        "hides, the upper face alone is seen, and the gap was 2 mm off",
    ),
    "fillet_radius_mm": Limit(
        (1.5, 60.0),
        "root radius of a U or J groove",
        "smaller ones are short of returns and come out 0.1 to 0.4 mm too small; the studies have 2 to 8",
    ),
    "groove_level": Limit(
        2.0,
        "how much higher one plate stands than the other, over the depth of the groove",
        "to 0.9 such grooves are measured right; a plate over a table, or lapped on another, is none and has 9",
    ),
    "not_confirmed": Limit(
        0.0,
        "count of the values that the import assumed and nobody has confirmed",
        "an assumed pitch or unit makes every length wrong, and no profile shows it",
    ),
}


# Of version 0.3.0, by what is to be said of it now.
GONE = {
    name: f"{now} judges that now"
    for now, names in {
        "found_share": ("edge_share", "groove_share", "preparation_share"),
        "agreement": ("groove_agreement", "groove_unread", "preparation_agreement"),
        "step_share": ("root_step_share", "end_face_step_share"),
        "goes_on_share": ("hollow_share", "end_face_goes_on_share"),
        "face_bow": ("corner_bow", "end_face_bow"),
        "groove_gap_mm": ("groove_overlap_mm",),
        "repeated_run": ("repeated_share",),
        "no check": ("size_scatter", "groove_told_share", "end_face_square_deg"),
    }.items()
    for name in names
}


def most(name: str) -> float:
    """Greatest value that the table allows."""
    bound = LIMITS[name].bound
    return bound[1] if isinstance(bound, tuple) else bound


def least(name: str) -> float:
    """Least value that the table allows."""
    bound = LIMITS[name].bound
    return bound[0] if isinstance(bound, tuple) else float("-inf")


# What stages of edges judge; the rest is judged of a recording.
OF_EDGES = {
    "edge.segment": "complement_nearer_deg corner_stands_out_mm edge_break_mm end_step_columns face_bend_deg face_bow "
    "found_share goes_on_share readings_apart root_columns root_over_nominal root_seen_share step_share "
    "two_plates_share",
    "edge.segment_raw": "edge_break_mm end_face_lean_deg end_step_columns face_behind_share face_bend_deg face_bow "
    "goes_on_share late_turn_deg step_share two_plates_share",
    "edge.segment_groove": "agreement bevel_grazing face_bend_deg face_bow face_columns fillet_misfit fillet_radius_mm "
    "found_share groove_compound groove_gap_mm groove_level root_face_lean_deg root_levels",
    "edge.segment_preparation": "agreement corner_stands_out_mm edge_break_mm face_bend_deg face_bow face_columns "
    "fillet_misfit_mm found_share land_tilt_deg root_columns root_extent_mm root_over_nominal root_seen_share "
    "two_plates_share",
}


def judged_by(stage: str = "") -> AfterValidator:
    """Limits that a user sets of a stage's checks; '': of those of a recording.

    ValueError: no such check, none of this stage, or not a number (two, where the check has two).
    """
    of_edges = {name for names in OF_EDGES.values() for name in names.split()}
    own = set(OF_EDGES[stage].split()) if stage else LIMITS.keys() - of_edges

    def checked(given: dict[str, Bound]) -> dict[str, Bound]:
        for name, value in given.items():
            if name not in LIMITS:
                raise ValueError(f"{name}: {GONE.get(name, f'no such check{nearest(name, LIMITS)}')}")
            if name not in own:
                others = [other for other, names in OF_EDGES.items() if name in names.split()] or ["scan.fuse"]
                raise ValueError(f"{name}: not judged by this stage, but by {', '.join(others)}: set it there")
            bound = LIMITS[name].bound
            if isinstance(bound, tuple) != isinstance(value, tuple):
                usual = f"two numbers, such as {list(bound)}" if isinstance(bound, tuple) else "a number"
                raise ValueError(f"{name}: expected {usual}")
        return given

    return AfterValidator(checked)


Limits: TypeAlias = Annotated[dict[str, Bound], judged_by()]  # of the checks of a recording, set by name


def within(value: float | None, bound: Bound) -> bool:
    """Is the value allowed? What was not found is."""
    if value is None or value != value:
        return True
    low, high = bound if isinstance(bound, tuple) else (float("-inf"), bound)
    return bool(low <= value <= high)


def check(
    name: str,
    value: float | None,
    finding: str = "",
    *,
    given: Mapping[str, Bound] | None = None,
    default: Bound | None = None,
) -> Check:
    """The check `name` of a value, NaN or None where there was nothing to judge by.

    Args:
        name: of LIMITS.
        value: what was found.
        finding: what was found, in words.
        given: limits that a user set.
        default: in place of the table's bound, where that depends on the recording.
    """
    rule = LIMITS[name].bound if default is None else default
    bound = (given or {}).get(name, rule)
    number = None if value is None or value != value else float(value)
    passed = within(number, bound)
    return Check(name, number, bound, passed, LIMITS[name].reason, finding, passed and not within(number, rule))
