"""Modes of the robot: pin's mass matrix, solids, tap tests of a known robot, their files, and what is refused."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.seldom import seldom
from workbench.artefacts import Cutter
from workbench.errors import InputError
from workbench.plugins.stiffness import modes
from workbench.plugins.stiffness.coefficients import CuttingCoefficients
from workbench.plugins.stiffness.dynamics import _solid, bodies_of, mass_matrix
from workbench.plugins.stiffness.margins import Cuts, screen_limits, u_of_modes
from workbench.plugins.stiffness.modes_stage import _Taps, at_posture, fitted, swings
from workbench.plugins.stiffness.tap_tests import TapTests, read_tap_tests
from workbench.plugins.stiffness.values import CuttingProcess
from workbench.robot import Shape, forward_kinematics, read_cell

ROOT = Path(__file__).parents[3]
MASSES = (400.0, 300.0, 200.0, 120.0, 30.0, 5.0)
HZ = np.arange(4.0, 80.0, 0.5)
AXES = "xyz"


def with_inertias(folder: Path) -> Path:
    """The shipped cell, its URDF with masses."""
    bodies = bodies_of(dataclasses.replace(read_cell(ROOT / "data/robot/cell.json"), tool_mass_kg=None), MASSES)
    model = pin.buildModelFromUrdf(str(ROOT / "data/robot/irb6700_150_320.urdf"))
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    text = (ROOT / "data/robot/irb6700_150_320.urdf").read_text()
    for k in range(6):
        own = data.oMi[k + 1].actInv(pin.Inertia(bodies.mass_kg[k], bodies.centre_mm[k] / 1e3, bodies.inertia_kg_m2[k]))
        x, i = own.lever, own.inertia
        inertial = (
            f'<inertial><origin xyz="{x[0]} {x[1]} {x[2]}"/><mass value="{own.mass}"/><inertia ixx="{i[0, 0]}" '
            f'ixy="{i[0, 1]}" ixz="{i[0, 2]}" iyy="{i[1, 1]}" iyz="{i[1, 2]}" izz="{i[2, 2]}"/></inertial>'
        )
        text = text.replace(f'<link name="link_{k + 1}">', f'<link name="link_{k + 1}">{inertial}')
    (folder / "irb6700_150_320.urdf").write_text(text)
    (folder / "cell.json").write_text((ROOT / "data/robot/cell.json").read_text())
    return folder / "cell.json"


def test_mass_matrix_is_pins(tmp_path: Path) -> None:
    cell = read_cell(with_inertias(tmp_path))
    assert cell.chain.bodies is not None
    model = pin.buildModelFromUrdf(str(tmp_path / "irb6700_150_320.urdf"))
    data = model.createData()
    q = np.random.default_rng(0).uniform(*cell.chain.limits.T, (20, 6))
    ours = mass_matrix(cell.chain, cell.chain.bodies, q)
    for k in range(20):
        upper = np.triu(pin.crba(model, data, q[k]))
        assert np.allclose(ours[k], upper + np.triu(upper, 1).T, atol=1e-9)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_mesh_is_its_box(sense: int) -> None:
    corners = np.array([[x, y, z] for x in (0, 300.0) for y in (0, 200.0) for z in (0, 100.0)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))])
    mesh = _solid(Shape("a", 1, "mesh", (), np.eye(4), corners, triangles[:, ::sense]))
    box = _solid(Shape("a", 1, "box", (300.0, 200.0, 100.0), np.eye(4)))
    assert mesh.mass == pytest.approx(box.mass) == 0.3 * 0.2 * 0.1
    assert np.allclose(mesh.lever, [0.150, 0.100, 0.050])
    assert np.allclose(mesh.inertia, box.inertia)


def test_static_compliance_is_the_stiffness(cell, stiffness) -> None:
    """At frequency 0 the modes add up to J K^-1 J^T, whatever the masses."""
    from workbench.plugins.stiffness.elastic import MM
    from workbench.robot import jacobian

    found, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    q = np.array([[0.1, 0.4, -0.2, 0.3, 1.0, 0.2]])
    there = forward_kinematics(cell.chain, q) @ cell.flange_from_cutter
    one = at_posture(cell, found, q)
    together = one.shape[0] @ np.linalg.solve(one.stiffness[0], one.shape[0].T)
    linear = there[0, :3, :3].T @ jacobian(cell.chain, q[0], cell.flange_from_cutter[:3, 3])[:3] / MM
    assert np.allclose(together, linear / stiffness.nm_per_rad @ linear.T, rtol=1e-9)
    assert np.allclose(swings(one)[1], 0.03, rtol=1e-6)


def tapped(cell, truth, seed: int, noise: float = 0.05, scale: float = 1.0, as_built: float = 0.0) -> TapTests:
    """Responses along three axes at eight postures of a known robot.

    as_built: times how well gain, delay, give beside the joints, centres and inertias are said to be known.
    """
    rng = np.random.default_rng(seed)
    q = rng.uniform([-1, -0.5, -0.6, -1, 0.5, -1], [1, 0.8, 0.5, 1, 1.5, 1], (8, 6))
    posture, hz = np.repeat(np.arange(8), 3 * len(HZ)), np.tile(HZ, 24)
    way = np.tile(np.repeat(np.eye(3), len(HZ), axis=0), (8, 1))
    point = np.tile(cell.flange_from_cutter[:3, 3], (8, 1))
    tests = TapTests("taps", q, point, posture, hz, np.ones(len(hz), complex), way, way, np.zeros(8, bool), 0)
    blurred = np.exp(noise * (rng.normal(size=len(hz)) + 1j * rng.normal(size=len(hz))))
    bodies, (gain, late, local) = truth.bodies, as_built * np.array([0.03, 1e-4, 1e-8]) * rng.normal(size=3)
    laid = dataclasses.replace(
        bodies,
        centre_mm=bodies.centre_mm + as_built * rng.normal(0, 30, (6, 3)),
        inertia_kg_m2=bodies.inertia_kg_m2 * np.exp(as_built * rng.normal(0, 0.2, 6))[:, None, None],
    )
    other = dataclasses.replace(truth, bodies=laid)
    value, _ = _Taps(cell.chain, other, tests, 1.0, np.ones(18), 0.0).compliance(np.zeros(47))
    heard = scale * np.exp(gain - 2j * np.pi * hz * late)
    return dataclasses.replace(tests, value=heard * (value + local) * blurred)


def truth_of(begun, seed: int):
    """A robot within what is declared, its joints damped apart."""
    rng = np.random.default_rng(seed)
    moved = begun.moved(np.concatenate([rng.normal(0, 0.07, 6), rng.normal(0, 0.2, 6), [0.0]]))
    dampers = 0.06 * np.exp(rng.normal(0, 0.2, 6)) * np.sqrt(moved.nm_per_rad * np.array([3e3, 3e3, 9e2, 60, 50, 8]))
    return dataclasses.replace(moved, damping=dampers, covariance=np.zeros((18, 18)))


def written(folder: Path, tests: TapTests, kind: str = "compliance", change: Callable[[str], str] = str) -> Path:
    """As a list and its files."""
    listed = []
    for k, q in enumerate(tests.joints):
        rows = tests.posture == k
        power = {"compliance": 0, "mobility": 1, "accelerance": 2}[kind]
        columns = [tests.value[rows & (tests.to[:, axis] == 1)] * (2j * np.pi * HZ) ** power for axis in range(3)]
        head = "hz," + ",".join(f"{a}{a}_re,{a}{a}_im" for a in AXES)
        body = [
            ",".join([f"{f:.3f}", *(f"{v.real:.12e},{v.imag:.12e}" for v in row)])
            for f, *row in zip(HZ, *columns, strict=True)
        ]
        (folder / f"{k}.csv").write_text(change("\n".join([head, *body, ""])))
        listed.append({"file": f"{k}.csv", "joints_deg": np.degrees(q).tolist(), "kind": kind})
    path = folder / "taps.json"
    path.write_text(json.dumps({"format": "tap-tests", "version": 1, "tests": listed}))
    return path


@pytest.mark.parametrize("assumed", [1.0, *seldom(0.0)])
def test_tap_tests_find_the_robot(cell, stiffness, tmp_path: Path, assumed: float) -> None:
    """Whatever of gain, delay, links and give beside the joints is not as stated is in u; the noise alone else."""
    begun, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    share = []
    for seed in (3, 13) if assumed else (3,):
        truth = truth_of(begun, seed)
        path = written(tmp_path, tapped(cell, truth, seed + 1, as_built=assumed))
        found, file, _ = modes(cell, stiffness, taps=path, link_masses_kg=MASSES, as_built_u=assumed)
        u = np.sqrt(np.diag(found.covariance))
        off = np.log(
            np.concatenate(
                [
                    found.nm_per_rad / truth.nm_per_rad,
                    found.bodies.mass_kg / truth.bodies.mass_kg,
                    found.damping / truth.damping,
                ]
            )
        )
        share.append(off / u)
        assert np.abs(off[:6]).max() < (0.08 if assumed else 0.02)
        assert found.misfit == pytest.approx(1.0, abs=0.1)
        assert found.declared == ()
        assert json.loads(file.content)["misfit"] == pytest.approx(found.misfit)
    assert 0.3 < np.sqrt(np.mean(np.square(share))) < 1.8
    assert np.abs(share).max() < 4


@pytest.mark.slow
def test_tap_tests_predict_the_limits_of_other_postures(cell, stiffness) -> None:
    """Eight postures, 5 % of noise: the limits of ten others within 15 %, and U (k = 2) holds in 93 to 97 %."""
    begun, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    process = CuttingProcess(CuttingCoefficients(800.0, 250.0, 0.0, 0.0, 0.0, 0.0), 0.5)
    low, high = [-1, -0.5, -0.6, -1, 0.5, -1], [1, 0.8, 0.5, 1, 1.5, 1]
    off, share = [], []
    for seed in range(16):
        truth = truth_of(begun, seed)
        found = fitted(cell.chain, begun, tapped(cell, truth, seed + 100), 0.05, 0.0)
        q = np.random.default_rng(seed + 500).uniform(low, high, (10, 6))
        frames, one = forward_kinematics(cell.chain, q) @ cell.flange_from_cutter, np.ones(10)
        cuts = Cuts(Cutter(10.0, 4, 20.0), process, 6000.0, np.arange(10), frames, np.zeros((10, 3)), one, one, one)
        for way in (0, 1):
            true, told = (screen_limits(cuts.dynamics(cell.chain, each, q), cuts, way) for each in (truth, found))
            u = u_of_modes(cell.chain, found, cuts, q, way)
            both = np.isfinite(true) & np.isfinite(told)
            off.extend(np.log(told[both] / true[both]))
            share.extend(np.abs(np.log(told[both] / true[both])) / u[both])
    assert len(off) > 200
    assert np.abs(off).max() < np.log(1.15)
    assert np.mean(np.array(share) < 2) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("kind", ["mobility", "accelerance"])
def test_responses_of_any_kind_are_the_same(cell, stiffness, tmp_path: Path, kind: str) -> None:
    begun, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    tests = tapped(cell, truth_of(begun, 3), 4)
    read = read_tap_tests(written(tmp_path, tests, kind), cell.flange_from_cutter[:3, 3], (4.0, 80.0))
    assert np.allclose(read.value, tests.value, rtol=1e-9)
    assert (read.to == tests.to).all()
    assert (read.by == tests.by).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("yy_im", "yy_imaginary"), "'yy_im' is missing"),
        (lambda text: "hello,there\n1,2\n", "the column 'hz'"),
        (lambda text: "hz,there\n1,2\n2,2\n", "'xx_re' is missing"),
        (lambda text: text.replace("\n5.000", "\n4.000"), "rising"),
        (lambda text: text[: text.index("\n12.000")], "lines from 4 to 80"),
        (
            lambda text: text.replace("zz_im", "zz_im,zz_coherence").replace("\n", ",0.5\n").replace("nce,0.5", "nce"),
            "coherence",
        ),
        (
            lambda text: text.replace("zz_im", "zz_im,zz_coherence").replace("\n", ",\n").replace("nce,\n", "nce\n"),
            "zz_coherence: expected a finite number",
        ),
    ],
)
def test_spoilt_responses_are_one_line(cell, stiffness, tmp_path: Path, change, words: str) -> None:
    begun, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    path = written(tmp_path, tapped(cell, truth_of(begun, 3), 4), change=change)
    with pytest.raises(InputError, match=words) as error:
        modes(cell, stiffness, taps=path, link_masses_kg=MASSES)
    assert "\n" not in str(error.value)


def test_responses_in_other_units_or_of_another_robot_are_refused(cell, stiffness, tmp_path: Path) -> None:
    begun, *_ = modes(cell, stiffness, link_masses_kg=MASSES)
    truth = truth_of(begun, 3)
    for scale, words in ((1e3, "mm"), (9.80665, "in g")):
        path = written(tmp_path, tapped(cell, truth, 4, scale=scale))
        with pytest.raises(InputError, match=words):
            modes(cell, stiffness, taps=path, link_masses_kg=MASSES)
    softer = dataclasses.replace(truth, nm_per_rad=truth.nm_per_rad * [1, 1, 0.5, 1, 1, 1])
    path = written(tmp_path, tapped(cell, softer, 4))
    with pytest.raises(InputError, match="joint 3"):
        modes(cell, stiffness, taps=path, link_masses_kg=MASSES)


def test_no_masses_are_refused(cell, stiffness) -> None:
    with pytest.raises(InputError, match="link_masses_kg"):
        modes(cell, stiffness)
