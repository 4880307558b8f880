"""Loading tests of a robot whose stiffness is known: springs and load in balance, then noise."""

from __future__ import annotations

import numpy as np

from workbench.api import Chain, Float, LoadingSetup, forward_kinematics, vector_from_rotation
from workbench.plugins.stiffness.elastic import balance, wrench_at
from workbench.plugins.stiffness.loads import ANGLES, DISPLACEMENT, WRENCH
from workbench.plugins.stiffness.values import LoadingTests


def simulate_tests(
    chain: Chain,
    setup: LoadingSetup,
    stiffness: Float,
    joints: Float,
    wrench: Float,
    labels: tuple[str, ...],
    *,
    targets: int = 0,
    rng: np.random.Generator | None = None,
) -> LoadingTests:
    """Tests at postures (L, 6), rad, under wrenches (L, 6) in the sensor's axes; `targets` > 0: that many points.

    The robot rests where springs and load are in balance; the wrench keeps its direction in space. Noise out of the
    cell is added to wrench and displacement where `rng` is given.
    """
    points = np.vstack([setup.flange_from_tool[:3, 3], setup.targets_mm[:targets]])
    moved = np.array([_moved(chain, setup, stiffness, q, w, points) for q, w in zip(joints, wrench, strict=True)])
    if rng is not None:
        noise = np.array([setup.force_noise_n] * 3 + [setup.torque_noise_nm] * 3)
        wrench = wrench + rng.normal(size=wrench.shape) * noise
        rows = [setup.displacement_noise_mm] * 3 + [setup.rotation_noise] * 3 + [setup.target_noise_mm] * 3 * targets
        moved = moved + rng.normal(size=moved.shape) * rows
    return LoadingTests(
        source="simulated",
        labels=labels,
        lines=tuple(range(2, len(joints) + 2)),
        joints=joints,
        wrench=wrench,
        displacement=None if targets else moved[:, :6],
        targets_mm=moved[:, 6:].reshape(len(joints), targets, 3) if targets else None,
    )


def _moved(chain: Chain, setup: LoadingSetup, stiffness: Float, q: Float, wrench: Float, points: Float) -> Float:
    """Displacement of the tool frame (mm, rotation vector) and of the targets (mm)."""
    before = forward_kinematics(chain, q)
    sensor = before @ setup.flange_from_sensor
    in_base = wrench_at(sensor[:3, :3], np.zeros(3), wrench)
    _, dq = balance(chain, stiffness, q, setup.flange_from_sensor[:3, 3], in_base)
    after = forward_kinematics(chain, q + dq)
    way = (after - before)[:3] @ np.column_stack([points, np.ones(len(points))]).T
    turned = vector_from_rotation(after[:3, :3] @ before[:3, :3].T)
    return np.concatenate([way[:, 0], turned, way[:, 1:].T.reshape(-1)])


def loads_csv(tests: LoadingTests, comment: str = "") -> bytes:
    """The tests as a `loads.csv`."""
    if tests.targets_mm is None:
        assert tests.displacement is not None
        names = list(DISPLACEMENT)
        moved = np.hstack([tests.displacement[:, :3], np.degrees(tests.displacement[:, 3:])])
    else:
        names = [f"p{k + 1}{x}_mm" for k in range(tests.targets_mm.shape[1]) for x in "xyz"]
        moved = tests.targets_mm.reshape(len(tests.lines), -1)
    lines = [f"# {line}" for line in comment.splitlines()] + [",".join(["posture", *ANGLES, *WRENCH, *names])]
    for label, q, w, m in zip(tests.labels, np.degrees(tests.joints), tests.wrench, moved, strict=True):
        cells = [f"{v:.6f}" for v in q] + [f"{v:.4f}" for v in w]
        lines.append(",".join([label, *cells, *("" if np.isnan(v) else f"{v:.6f}" for v in m)]))
    return ("\n".join(lines) + "\n").encode()
