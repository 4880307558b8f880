"""The budget of root face and bevel angle against a Monte Carlo trial of the geometry (GUM Supplement 1)."""

from __future__ import annotations

from types import SimpleNamespace

import GTC
import numpy as np
import pytest

from workbench.artefacts import DECLARED, DIRECTIONS, END, FORM, ROUNDING, TANGENT
from workbench.edge.form import Form, Rounding
from workbench.edge.sizes import end_loose_mm, sizes, sudden
from workbench.geometry.course import Course
from workbench.units import Float

ROOT_MM, LEVER_MM = 1.5, 4.0
TRIALS = 200_000
AT = np.array([10.0, 50.0, 90.0])


def course(value: float, u: float, slope_u: float = 0.0) -> Course:
    return SimpleNamespace(
        value=lambda s: np.full(np.shape(s), value),
        u=lambda s: np.full(np.shape(s), u),
        slope=lambda s: np.zeros(np.shape(s)),
        slope_u=lambda s: np.full(np.shape(s), slope_u),
    )  # type: ignore[return-value]


def measured(beta: float, u: dict[str, float], run_root: float = 0.0, run_bevel: float = 0.0) -> SimpleNamespace:
    frames = np.linspace(0.0, 100.0, 200)
    tilt = 0.2

    def lines(run: float) -> SimpleNamespace:
        return SimpleNamespace(run=np.full(frames.size, run))

    faces = SimpleNamespace(
        root=lines(run_root),
        bevel=lines(run_bevel),
        root_course=course(tilt, u["root"]),
        bevel_course=course(tilt - beta, u["bevel"]),
        opening_course=course(beta, 9.0),
        even=None,
        follows=0.0,
    )
    return SimpleNamespace(
        faces=faces,
        ends=SimpleNamespace(
            low=np.full(frames.size, ROOT_MM - 0.02), step=np.full(frames.size, 0.05), sigma=np.full(frames.size, 0.01)
        ),
        end=SimpleNamespace(
            course=course(ROOT_MM, u["end"], u.get("drift", 0.0)),
            s=AT,
            departure=np.zeros(AT.size),
            middle=np.full(AT.size, ROOT_MM),
            middle_u=np.full(AT.size, 0.02),
        ),
        upper_s=frames,
        lever_mm=np.full(frames.size, LEVER_MM),
        root_turn=np.zeros(frames.size),
        bevel_turn=np.zeros(frames.size),
        shift=0.0,
        unsettled_mm=np.zeros(frames.size),
    )


def budget(beta: float, u: dict[str, float], tangent_u: float = 0.0, runs: tuple[float, float] = (0.0, 0.0)):  # type: ignore[no-untyped-def]
    none = Form(*(np.zeros(AT.size) for _ in range(3)))
    return sizes(measured(beta, u, *runs), AT, np.full(AT.size, tangent_u), none, Rounding(), 0.0)  # type: ignore[arg-type]


@pytest.mark.parametrize("beta_deg", [30.0, 40.0, 60.0])
@pytest.mark.parametrize(
    "u",
    [
        {"root": 2e-3, "bevel": 3e-4, "end": 2e-3},
        {"root": 2e-3, "bevel": 0.0, "end": 0.0},
        {"root": 0.0, "bevel": 1e-3, "end": 0.0},
    ],
)
def test_directions_and_end_add_up_as_a_trial_of_the_section_says(beta_deg: float, u: dict[str, float]) -> None:
    """In the section: lines turned about their centroids, the corner where they cross, the end along the root face."""
    beta = np.radians(beta_deg)
    rng = np.random.default_rng(9301)
    turn_root, turn_bevel = rng.normal(0.0, u["root"], TRIALS), rng.normal(0.0, u["bevel"], TRIALS)
    # Root face along x, its corner with the bevel at x = ROOT_MM; centroids half way down and LEVER_MM up the bevel.
    middle = np.array([0.5 * ROOT_MM, 0.0])
    spot = np.array([ROOT_MM + LEVER_MM * np.cos(beta), -LEVER_MM * np.sin(beta)])
    a, b = turn_root, -beta + turn_bevel
    d = spot - middle
    corner = (d[0] * np.sin(b) - d[1] * np.cos(b)) / (np.cos(a) * np.sin(b) - np.sin(a) * np.cos(b))
    end = rng.normal(-0.5 * ROOT_MM, u["end"], TRIALS)
    root, bevel = budget(beta, u)
    assert root.u == pytest.approx(np.std(corner - end), rel=0.02)
    assert bevel.u == pytest.approx(np.std(a - b), rel=0.02)


@pytest.mark.parametrize("beta_deg", [30.0, 40.0, 60.0])
def test_the_budget_is_that_of_an_independent_calculator(beta_deg: float) -> None:
    """GTC differentiates the section's own geometry; the budget has its derivatives from the method's page."""
    beta, u = np.radians(beta_deg), {"root": 2e-3, "bevel": 3e-4, "end": 2e-3}
    turn_root, turn_bevel, end = (GTC.ureal(0.0, u[name]) for name in ("root", "bevel", "end"))
    dx, dz = ROOT_MM + LEVER_MM * np.cos(beta) - 0.5 * ROOT_MM, -LEVER_MM * np.sin(beta)
    a, b = turn_root, -beta + turn_bevel
    corner = (dx * GTC.sin(b) - dz * GTC.cos(b)) / (GTC.cos(a) * GTC.sin(b) - GTC.sin(a) * GTC.cos(b))
    root, bevel = budget(beta, u)
    assert root.u == pytest.approx(GTC.uncertainty(corner + 0.5 * ROOT_MM - end), rel=0.02)
    assert bevel.u == pytest.approx(GTC.uncertainty(a - b), rel=0.02)
    np.testing.assert_allclose(root.u_by_source[END], GTC.component(corner - end, end), rtol=0.02)
    both = np.hypot(GTC.component(corner, turn_root), GTC.component(corner, turn_bevel))
    np.testing.assert_allclose(root.u_by_source[DIRECTIONS], both, rtol=0.02)


@pytest.mark.parametrize("runs", [(0.2, 0.35), (-0.3, 0.1), (0.0, 0.4)])
def test_the_tangent_turns_the_angle_as_a_trial_in_space_says(runs: tuple[float, float]) -> None:
    """Lines of both faces in space, projected along tangents that are off by u each way."""
    beta, u = np.radians(40.0), 1e-3
    rng = np.random.default_rng(9302)
    off = rng.normal(0.0, u, (TRIALS, 2))
    t = np.stack([off[:, 0], off[:, 1], np.ones(TRIALS)], axis=1)
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    a = np.array([1.0, 0.0, 0.0]) - t * t[:, :1]
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    b = np.cross(t, a)
    angles = []
    for direction, run in ((0.2, runs[0]), (0.2 - beta, runs[1])):
        line = np.array([np.cos(direction), np.sin(direction), run])
        angles.append(np.arctan2(b @ line, a @ line))
    _, bevel = budget(beta, {"root": 0.0, "bevel": 0.0, "end": 0.0}, u, runs)
    assert bevel.u_by_source[TANGENT] == pytest.approx(np.std(angles[0] - angles[1]), rel=0.02)


def test_each_source_stands_where_it_belongs() -> None:
    beta = np.radians(40.0)
    form = Form(np.full(AT.size, 0.003), np.full(AT.size, 0.004), np.full(AT.size, 0.02))
    state = measured(beta, {"root": 0.0, "bevel": 0.0, "end": 0.01, "drift": 0.002}, 0.0, 0.5)
    root, bevel = sizes(state, AT, np.zeros(AT.size), form, Rounding(0.2, 0.05, 0.03, 0.1), 0.04)  # type: ignore[arg-type]
    np.testing.assert_allclose(root.value, ROOT_MM + 0.05)
    expected = {END: 0.01, FORM: 0.02, ROUNDING: 0.03, DECLARED: 0.04, TANGENT: 0.0, DIRECTIONS: 0.0}
    for name, value in expected.items():
        np.testing.assert_allclose(root.u_by_source[name], value)
    np.testing.assert_allclose(bevel.u_by_source[FORM], 0.005)
    np.testing.assert_allclose(bevel.u_by_source[DIRECTIONS], 0.5 * np.sin(beta) * 0.002)
    np.testing.assert_allclose(root.u, np.sqrt(sum(v**2 for v in expected.values())))


def test_what_most_frames_say_against_the_course_is_uncertainty() -> None:
    """Returns lost in a block, a gouge: the smooth course may leave such frames out, not without a trace."""
    state = measured(0.7, {"root": 0.0, "bevel": 0.0, "end": 0.002}, 0.0, 0.3)
    state.end.departure = np.array([0.0, -0.8, 0.0])
    root, bevel = sizes(state, AT, np.zeros(AT.size), Form(*(np.zeros(AT.size) for _ in range(3))), Rounding(), 0.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(root.u, [0.002, np.hypot(0.002, 0.8), 0.002])
    assert bevel.u[1] > 0.03
    assert bevel.u[0] < 1e-3


def test_a_sudden_change_under_a_smooth_course_is_uncertain_by_all_of_it() -> None:
    """A spline runs through a burr in the plane of the face as if it were a wave: within the steps of the columns."""
    at = np.arange(1.0, 120.0, 2.0)
    burr = 0.15 * ((at > 30.0) & (at < 50.0))
    steps = 0.5 * 0.05 * np.sign(np.sin(at))
    smooth = SimpleNamespace(s=at, departure=np.zeros(at.size), middle=1.5 + steps, middle_u=np.full(at.size, 0.015))
    assert not end_loose_mm(smooth, at).any()  # type: ignore[arg-type]
    smooth.middle = smooth.middle + burr
    loose = end_loose_mm(smooth, at)  # type: ignore[arg-type]
    assert (loose[burr > 0] > 0.1).all()
    assert (loose[np.abs(at - 40.0) > 32.0] == 0.0).all()


def profile(change: Float) -> tuple[Float, Float]:
    at = np.arange(0.0, 200.0)
    return at, sudden(at, 1.5 + change, np.full(at.size, 0.002))


def test_a_sudden_change_is_uncertain_by_all_of_it_and_a_drift_is_not() -> None:
    s = np.arange(0.0, 200.0)
    at, lost = profile(np.where(np.abs(s - 100.0) < 6.0, -0.2, 0.0))
    assert (lost[np.abs(at - 100.0) < 6.0] > 0.15).all()
    assert (lost[np.abs(at - 100.0) > 22.0] == 0.0).all()
    assert (profile(0.002 * s)[1] == 0.0).all()
    assert (profile(0.05 * np.sin(2 * np.pi * s / 80.0))[1] == 0.0).all()


def test_a_level_that_has_not_most_of_the_edge_is_no_truth() -> None:
    s = np.arange(0.0, 200.0)
    _, third = profile(np.where(s > 160.0, -0.2, 0.0))
    assert (third[s > 166.0] > 0.15).all()
    assert (third[s < 138.0] == 0.0).all()
    _, half = profile(np.where(s > 100.0, -0.2, 0.0))
    assert (half > 0.15).all()


def test_waves_are_steep_everywhere_and_a_burr_is_not() -> None:
    s = np.arange(0.0, 200.0)
    assert (profile(0.05 * np.sin(2 * np.pi * s / 15.0))[1] == 0.0).all()
    burr = profile(0.09 * np.exp(-(((s - 120.0) / 4.0) ** 2)))[1]
    assert burr[120] > 0.08
    assert (burr[np.abs(s - 120.0) > 32.0] == 0.0).all()
