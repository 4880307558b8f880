"""`stiffness.modes`: how the robot swings at the tool, from masses and joint stiffness, or fitted to tap tests."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from workbench.api import (
    DEG,
    NO_NAMES,
    UNKNOWN_PART,
    AnyArray,
    Cell,
    Chain,
    Chapter,
    Document,
    Float,
    InputError,
    InputFile,
    PartNames,
    estimator,
    forward_kinematics,
    jacobian,
    pieces,
    result_file,
    stage,
)
from workbench.plugins.ranges import AsBuiltU, RelativeU
from workbench.plugins.stiffness.dynamics import at_tool, bodies_of, mass_matrix
from workbench.plugins.stiffness.elastic import MM
from workbench.plugins.stiffness.stability import Dynamics
from workbench.plugins.stiffness.tap_tests import TapTests, read_tap_tests
from workbench.plugins.stiffness.values import JointStiffness, RobotModes, ToolMode

Mass = Annotated[float, Field(gt=0, le=1e4)]
Angle = Annotated[float, Field(ge=-720, le=720)]
Hertz = Annotated[float, Field(gt=0, le=1e4)]
FLAT = 2.0  # u of a logarithm that nobody knows: a factor of seven
FLOOR = 0.02  # of the middle response: noise that does not fall with the response
CONTRADICTS = 3.0  # times the standard uncertainty, from the stated stiffness
STEP = 1e-3  # of a unit, for derivatives
TOO_MUCH = 25.0  # chi-square over its degrees of freedom: the model is another's
# Beside the joints' 18 parameters, how well a robot is known that is tapped (u); one unit of an unknown each:
CENTRE_U_MM, INERTIA_U = 30.0, 0.2  # of each link's centre of mass, along each axis; of its inertia about it, over it
LOCAL_U_M_N = 1e-8  # what gives beside the joints, along each axis of the forces
GAIN_U, DELAY_U_S = 0.03, 1e-4  # of hammer and pick-up together; of one against the other
LEAST = 1e-3  # of these, for a robot that is exactly as stated
JOINTS, LINKS, MEASUREMENT = 18, 42, 5  # unknowns up to the joints' and links'; of a tap: local give, gain, delay
SCALES = {1e3: "in 1/mm or mm", 1e-3: "in mm, not m", 9.80665: "in g, not m/s2", 1 / 9.80665: "in g, not m/s2"}


@stage("stiffness.modes")
def modes(
    cell: Cell,
    stiffness: JointStiffness,
    *,
    taps: InputFile | None = None,
    link_masses_kg: tuple[Mass, Mass, Mass, Mass, Mass, Mass] | None = None,
    mass_relative_u: Annotated[float, Field(gt=0, le=2)] = 0.3,
    stiffness_relative_u: Annotated[float, Field(ge=0, le=2)] = 0.1,
    damping_ratio: Annotated[float, Field(gt=0, lt=1)] = 0.03,
    damping_relative_u: Annotated[float, Field(gt=0, le=2)] = 0.5,
    tool_frequency_hz: Hertz | None = None,
    tool_damping_ratio: Annotated[float, Field(gt=0, lt=1)] = 0.02,
    tool_stiffness_n_um: Annotated[float, Field(gt=0, le=1e4)] = 20.0,
    band_hz: tuple[Hertz, Hertz] = (4.0, 80.0),
    response_relative_u: RelativeU = 0.05,
    as_built_u: AsBuiltU = 1.0,
    joints_deg: tuple[Angle, Angle, Angle, Angle, Angle, Angle] = (0, 38, -5, 20, 55, -10),
    part: PartNames = NO_NAMES,
) -> tuple[RobotModes, Document, Chapter]:
    """Mass, stiffness and damping of the robot at the tool, declared or fitted to tap tests.

    Rigid links on springs and dampers, with masses from the URDF (or given) and declared damping: with tap tests
    priors of the fit (docs/stiffness.md). Writes `modes.json`.

    Args:
        cell: the robot, with its tool's mass and centre of gravity.
        stiffness: of its joints; with u, a prior of the fit.
        taps: a list of tap tests (JSON) with their CSV files (docs/stiffness.md); null: none.
        link_masses_kg: of the six links, spread evenly in their shapes; null: the URDF's.
        mass_relative_u: ratio of standard uncertainty to value of each link's mass.
        stiffness_relative_u: likewise a ratio, of each joint's stiffness, where `stiffness` is without.
        damping_ratio: of all modes, as a share of critical damping; with tap tests the start of the fit.
        damping_relative_u: ratio of standard uncertainty to value of it.
        tool_frequency_hz: of the first mode of spindle and cutter; null: none that counts.
        tool_damping_ratio: of that mode, as a share of the critical.
        tool_stiffness_n_um: of that mode at the cutter's tip, a number of N/um.
        band_hz: of the responses that are fitted.
        response_relative_u: ratio of standard uncertainty to size of a line of a response.
        as_built_u: factor on the standard uncertainties of what else is unknown (docs/stiffness.md); 0: as stated.
        joints_deg: the posture whose modes are listed.
        part: whose tests they are, for the file and the page.

    Raises:
        InputError: no masses; a file of another kind or of too low a coherence; responses that the model does not fit,
            or that contradict the stated stiffness.

    Example:
        >>> from workbench import robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> masses = [400, 300, 200, 120, 30, 5]
        >>> found, file, chapter = stiffness.modes(cell, stiffness.read(cell), link_masses_kg=masses)
        >>> len(found.declared), file.name
        (3, 'modes.json')
    """
    bodies = bodies_of(cell, link_masses_kg)
    stated = estimator.standard_u(stiffness.covariance) / stiffness.nm_per_rad
    k_relative = np.where(stated > 0, stated, stiffness_relative_u)
    u = np.concatenate([k_relative, np.full(6, mass_relative_u), [damping_relative_u]])
    tool = None
    if tool_frequency_hz is not None:
        tool = ToolMode(tool_frequency_hz, tool_damping_ratio, tool_stiffness_n_um)
    declared = [
        f"damping: {damping_ratio:g} of critical ± {2 * damping_relative_u * damping_ratio:.2g} (k = 2), not measured",
        f"masses: {'of the URDF' if link_masses_kg is None else 'given, even in the collision shapes'}, "
        f"± {200 * mass_relative_u:.0f} % (k = 2)",
    ]
    if not stated.any():
        declared.append(f"stiffness: without u, ± {200 * stiffness_relative_u:.0f} % (k = 2) assumed")
    begun = RobotModes(stiffness.nm_per_rad, bodies, np.array([damping_ratio]), np.diag(u**2), tool, tuple(declared))
    if taps is None:
        found, tests = begun, None
    else:
        tests = read_tap_tests(taps, cell.flange_from_cutter[:3, 3], band_hz)
        found = fitted(cell.chain, begun, tests, response_relative_u, as_built_u)
    joints = np.array([joints_deg], float) * DEG
    who = UNKNOWN_PART.with_names(part)
    shown = at_posture(cell, found, joints)
    frequency, ratio = swings(shown)
    example = {
        "joints_deg": list(joints_deg),
        "frequency_hz": frequency,
        "damping_ratio": ratio,
        "shape_per_sqrt_kg": shown.shape[0].T,
    }
    chapter = replace(_chapter(found, example, tests), part=who, about="instruments")
    return found, _document(found, asdict(who), example), chapter


def at_posture(cell: Cell, modes: RobotModes, joints: Float) -> Dynamics:
    """At the cutter's tip, in the cutter's axes, of postures (k, 6)."""
    return at_tool(cell.chain, modes, joints, forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter)


class _Taps:
    """The estimator's instrument: logarithms of compliances, whose noise is even; by unknowns in units of their u."""

    def __init__(
        self, chain: Chain, start: RobotModes, tests: TapTests, relative_u: float, prior: Float, as_built_u: float
    ) -> None:
        """`prior`: standard uncertainties (18,) of the joints'; as_built_u: likewise of all other unknowns."""
        self.chain, self.start, self.tests, self.relative_u = chain, start, tests, relative_u
        self.prior = np.append(prior, np.full(LINKS + MEASUREMENT - len(prior), max(as_built_u, LEAST)))
        flange = forward_kinematics(chain, tests.joints)[:, :3, :3]
        turn = np.where(tests.in_flange[:, None, None], flange, np.eye(3))
        linear = np.array([jacobian(chain, q, at)[:3] for q, at in zip(tests.joints, tests.point_mm, strict=True)]) / MM
        both = np.stack([tests.to, tests.by], axis=1)
        inside = np.einsum("nrc,nac->nar", turn[tests.posture], both)
        # of the response's and the force's direction (n, 2, 6), m/rad
        self.slopes = np.einsum("nar,nri->nai", inside, linear[tests.posture])

    def robot(self, at: Float) -> RobotModes:
        """With the unknowns (42,) of its joints and links, and what stands beside these."""
        centres, inertias = np.split(at[JOINTS:LINKS].reshape(-1, 6), [3])
        now = self.start.moved(at[:JOINTS])
        centre = now.bodies.centre_mm + CENTRE_U_MM * centres.T
        inertia = now.bodies.inertia_kg_m2 * np.exp(INERTIA_U * inertias[0])[:, None, None]
        return replace(now, bodies=replace(now.bodies, centre_mm=centre, inertia_kg_m2=inertia))

    def _mechanics(self, at: Float) -> Float:
        """Mass, damping and stiffness about the joints, of each posture in a row (p, 3 * 6 * 6)."""
        now, parts = self.robot(at), np.zeros((len(self.tests.joints), 3, 6, 6))
        parts[:, 0] = mass_matrix(self.chain, now.bodies, self.tests.joints)
        parts[:, 1], parts[:, 2] = np.diag(now.damping), np.diag(now.nm_per_rad)
        return parts.reshape(len(parts), -1)

    def compliance(self, at: Float) -> tuple[AnyArray, AnyArray]:
        """Complex (n,), m/N, and its derivative (n, 42) by the unknowns of joints and links."""
        posture, swing = self.tests.posture, 2j * np.pi * self.tests.hz
        powers = np.stack([swing**2, swing, np.ones_like(swing)], axis=1)
        parts = self._mechanics(at).reshape(-1, 3, 6, 6)[posture]
        whole = np.einsum("nm,nmij->nij", powers, parts)
        to, by = np.moveaxis(np.linalg.solve(whole, self.slopes.mT.astype(complex)), 2, 0)
        moves = np.einsum("nm,ni,nj->nmij", powers, to, by).reshape(len(to), -1)
        slope = estimator.jacobian_of(lambda step: self._mechanics(at[:LINKS] + step), np.full(LINKS, STEP))
        change = np.zeros((len(to), LINKS), complex)
        for k, of_posture in enumerate(slope):
            change[posture == k] = -moves[posture == k] @ of_posture
        return np.einsum("ni,ni->n", self.slopes[:, 0], by), change

    def rows(self, at: Float) -> estimator.Rows:
        tests = self.tests
        value, change = self.compliance(at)
        heard = np.full(len(value), GAIN_U), -2j * np.pi * tests.hz * DELAY_U_S
        measurement = np.column_stack([LOCAL_U_M_N * tests.to * tests.by / value[:, None], *heard])
        parts = np.column_stack([np.log(tests.value / value), change / value[:, None], measurement])
        off, slope = np.split(np.stack([parts.real, parts.imag], axis=1), [1], axis=2)
        left, values = off[..., 0] - slope[..., LINKS:] @ at[LINKS:], np.full(len(value), 2.0)
        size = np.abs(tests.value)
        u2 = self.relative_u**2 + (FLOOR * np.median(size) * self.relative_u / size) ** 2
        covariance = u2[:, None, None] * np.eye(2)
        return estimator.Rows(left, slope, covariance, values, np.diag(self.prior**-2.0), -at)

    def moved(self, at: Float, step: Float) -> Float:
        return np.clip(at + step, -4.0, 4.0)


def fitted(chain: Chain, start: RobotModes, tests: TapTests, relative_u: float, as_built_u: float = 1.0) -> RobotModes:
    """Stiffness, masses and joint dampers fitted to tap tests; as_built_u: times the priors of all else.

    Raises:
        InputError: the model does not fit the responses; stiffness that contradicts the stated one.
    """
    inertia = np.einsum("kii->i", mass_matrix(chain, start.bodies, tests.joints)) / len(tests.joints)
    dampers = 2 * start.damping[0] * np.sqrt(start.nm_per_rad * inertia)
    begun = replace(start, damping=dampers, covariance=np.zeros((JOINTS, JOINTS)))
    u = estimator.standard_u(start.covariance)
    prior = np.concatenate([u[:12], np.full(6, FLAT)])
    calm = _Taps(chain, begun, tests, 10 * relative_u, prior, as_built_u)  # far from the answer, resonances mislead
    value, _ = calm.compliance(np.zeros(len(calm.prior)))  # its size below the resonances is known from the stiffness
    ratio = np.exp(np.median(np.log(np.abs(tests.value) / np.abs(value))))
    for scale, words in SCALES.items():
        if abs(np.log(ratio / scale)) < 0.5 * abs(np.log(scale)) and abs(np.log(ratio)) > np.log(4.0):
            raise InputError(
                tests.source,
                f"the responses are {ratio:.3g} times what stiffness and masses ask for: are they {words}?",
            )
    near = estimator.fit(calm, np.zeros(len(calm.prior)))
    taps = _Taps(chain, begun, tests, relative_u, prior, as_built_u)
    found = estimator.fit(taps, near.at)
    if not np.isfinite(found.chi2) or found.misfit > TOO_MUCH:
        raise InputError(
            tests.source,
            f"rigid links on joint springs do not fit these responses: misfit {found.misfit:.0f} where 1 is usual; are "
            "axes, point (point_mm), joint angles or kind others? A narrower band_hz leaves the links' own modes out",
        )
    change, known = found.at[:6], np.sqrt(np.diag(found.covariance)[:6] + prior[:6] ** 2)
    worst = int((np.abs(change) / known).argmax())
    if abs(change[worst]) > CONTRADICTS * known[worst]:
        raise InputError(
            tests.source,
            f"the responses ask for {np.exp(change[worst]):.2f} times the stated stiffness of joint {worst + 1}, "
            f"{abs(change[worst]) / known[worst]:.0f} u: another robot or load, or a wrong unit?",
        )
    notes: tuple[str, ...] = (f"{tests.left_out} lines of too low a coherence left out",) if tests.left_out else ()
    if len(tests.joints) < 3:
        notes += (f"{len(tests.joints)} postures only: masses and dampers are told apart by three or more",)
    return replace(
        taps.robot(found.at),
        covariance=found.covariance[:JOINTS, :JOINTS],
        declared=(),
        misfit=found.misfit,
        warnings=notes,
    )


NOT_INCLUDED = (
    "the links' own bending and the base's: modes above some 60 Hz of a large robot; they lower the limit where the "
    "teeth come near them",
    "friction and backlash of the joints: damping of small swings is larger, of large ones smaller than fitted",
    "the controller's own stiffness below some 5 Hz, which a standing robot shows and a moving one does not",
)


def _document(found: RobotModes, who: dict[str, object], example: dict[str, Any]) -> Document:
    return result_file(
        "modes.json",
        {
            "part": who,
            "joint_stiffness_nm_per_rad": found.nm_per_rad,
            "link_masses_kg": found.bodies.mass_kg,
            **(
                {"damping_ratio": found.damping[0]}
                if len(found.damping) == 1
                else {"joint_damping_nm_s_per_rad": found.damping}
            ),
            "parameters": found.names,
            "covariance_of_logarithms": found.covariance,
            "declared": list(found.declared),
            "misfit": found.misfit,
            "spindle_and_cutter": None if found.tool is None else asdict(found.tool),
            "example": example,
            "not_included": [*NOT_INCLUDED, *(f"not measured: {one}" for one in found.declared)],
            "warnings": list(found.warnings),
        },
    )


def swings(one: Dynamics) -> tuple[Float, Float]:
    """Frequencies (n,), Hz, and shares of critical damping (n,) of the modes of one place, as they decay."""
    n = one.stiffness.shape[1]
    whole = np.block([[np.zeros((n, n)), np.eye(n)], [-one.stiffness[0], -one.damping[0]]])
    roots = np.linalg.eigvals(whole)
    roots = roots[roots.imag > 0]
    roots = roots[np.argsort(np.abs(roots))]
    return np.abs(roots) / (2 * np.pi), -roots.real / np.abs(roots)


def _chapter(found: RobotModes, example: dict[str, Any], tests: TapTests | None) -> Chapter:
    frequency, ratio, joints_deg = example["frequency_hz"], example["damping_ratio"], example["joints_deg"]
    u = estimator.standard_u(found.covariance)
    rows = [(f"{k}", f"{f:.1f}", f"{100 * z:.1f}") for k, (f, z) in enumerate(zip(frequency, ratio, strict=True), 1)]
    values = np.concatenate([found.nm_per_rad, found.bodies.mass_kg, found.damping])
    known = [(name, f"{v:.4g}", f"{200 * s:.0f} %") for name, v, s in zip(found.names, values, u, strict=True)]
    origin = "declared" if tests is None else f"from tap tests at {len(tests.joints)} postures"
    summary = f"Modes at the tool, {origin}: the lowest at {frequency[0]:.1f} Hz in the posture shown"
    misfit = "" if found.misfit is None else f" Misfit of the responses: {found.misfit:.2f} (1 is usual)."
    text = (
        pieces.paragraph(f"At joint angles {', '.join(f'{q:g}' for q in joints_deg)}°, at the cutter's tip.{misfit}")
        + pieces.table_html(("Mode", "Frequency, Hz", "Damping, % of critical"), rows)
        + pieces.table_html(("Parameter", "Value (Nm/rad, kg, ratio or Nm·s/rad)", "U / value"), known)
        + pieces.list_html([*(f"Declared: {one}" for one in found.declared), *found.warnings])
        + pieces.list_html([f"Not included: {one}" for one in NOT_INCLUDED])
    )
    return Chapter("Modes of the robot", text, summary=summary)
