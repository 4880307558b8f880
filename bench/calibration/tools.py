"""Tool and turntable as their stages find them, beside the bound of Cramer and Rao by differences of the motion."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bench.tables import markdown
from workbench.api import DEG, Float, quaternion_from_rotation, rotation_from_vector
from workbench.plugins.calibration import tcp, turntable

AXIS = np.array([0.02, -0.03, 1.0]) / np.linalg.norm([0.02, -0.03, 1.0])  # of the turntable
ON_AXIS_MM = np.array([1500.0, 200.0, 400.0])
TIP_MM = np.array([80.0, -20.0, 250.0])  # on the flange
NOISE_MM, NOISE_DEG = 0.05, 0.01
SHANK_MM = TIP_MM - [0.0, 0.0, 50.0]
REFERENCES_MM = np.array([[1200.0, 100.0, 600.0], [1300.0, -200.0, 650.0]])
TOUCHES, BALL_TOUCHES, BESIDE_MM = 16, 30, 8.0
ANGLES_DEG, ANGLE_NOISE_DEG, MARKERS = (0.0, 40.0, 80.0, 120.0), 0.002, 3
STEP = 1e-4


def statement(trials: int) -> Iterator[str]:
    """Errors of tip and axis beside bound and stated u, root mean square over the trials and the directions."""
    rows = []
    for name, one in (
        ("tip, touched on points, mm", lambda rng: _tool(rng, TOUCHES, 0.0)),
        ("tip, balls touched, mm", lambda rng: _tool(rng, BALL_TOUCHES, BESIDE_MM)),
        ("turntable's axis beside its middle, mm", _axis_place),
        ("turntable's axis, direction, deg", _axis_direction),
    ):
        found = [one(np.random.default_rng([seed, 0x7001])) for seed in range(trials)]
        off, bound, covariance = (np.array([each[k] for each in found]) for k in range(3))
        u = np.sqrt(np.array([np.diag(c) for c in covariance]))
        sizes = [f"{np.sqrt(np.mean(v)):.4f}" for v in (off**2, [np.diag(b) for b in bound], u**2)]
        rows.append([name, *sizes, f"{100 * np.mean(np.abs(off) <= 2 * u):.0f}"])
    yield from markdown(["", "RMSE, each direction", "bound", "stated u", "within 2u, %"], rows)


def _tool(rng: np.random.Generator, count: int, beside_mm: float) -> tuple[Float, Float, Float]:
    """Error (3,), bound (3, 3) and covariance of the tip; two references, nobody knows where."""
    turn = rotation_from_vector(0.6 * rng.normal(size=(count, 3)))
    points = TIP_MM if beside_mm else np.where(np.arange(count)[:, None] % 2 == 0, TIP_MM, SHANK_MM)
    lever = np.einsum("nij,nj->ni", turn, np.broadcast_to(points, (count, 3)))
    side = rotation_from_vector(0.5 * rng.normal(size=(count, 3)))
    way = np.einsum("nij,nj->ni", side, -lever / np.linalg.norm(lever, axis=1)[:, None])
    which = np.arange(count) // (1 if beside_mm else 2) % 2
    exact = REFERENCES_MM[which] + beside_mm * way - lever
    at = exact + NOISE_MM * rng.normal(size=(count, 3)) - np.cross(NOISE_DEG * DEG * rng.normal(size=(count, 3)), lever)
    rows = [
        f"ball {k},{'shank' if i % 2 and not beside_mm else 'tip'},"
        + ",".join(f"{v:.9f}" for v in [*p, *quaternion_from_rotation(r), beside_mm])
        for i, (k, p, r) in enumerate(zip(which, at, turn, strict=True))
    ]
    header = "reference,tool_point,x_mm,y_mm,z_mm,qw,qx,qy,qz,stand_off_mm"
    given = {"robot_noise_mm": NOISE_MM, "robot_noise_deg": NOISE_DEG, "touch_noise_mm": 0.0, "max_u_mm": 10.0}
    found = _asked(lambda path: tcp(touches=path, **given), header, rows)["points"][0]

    def told(x: Float) -> Float:
        """What touches measure with tip, shank and both references moved by x (12,), in standard deviations."""
        shift = np.where(np.arange(count)[:, None] % 2 == 0, x[:3], x[:3] if beside_mm else x[3:6])
        off = np.einsum("nij,nj->ni", turn, shift) - x[6:].reshape(2, 3)[which]
        square = NOISE_MM**2 * np.eye(3) + (NOISE_DEG * DEG) ** 2 * (
            (lever**2).sum(axis=1)[:, None, None] * np.eye(3) - lever[:, :, None] * lever[:, None, :]
        )
        if beside_mm:
            apart = np.linalg.norm(beside_mm * way + off, axis=1)
            return np.asarray(apart / np.sqrt(np.einsum("ni,nij,nj->n", way, square, way)))
        return np.linalg.solve(np.linalg.cholesky(square), off[..., None]).ravel()

    used = np.r_[0:3, 6:12] if beside_mm else np.arange(12)
    bound = _bound(lambda x: told(_into(x, used, 12)), len(used))[:3, :3]
    return np.array(found["position_mm"]) - TIP_MM, bound, np.array(found["covariance_mm2"])


def _axis_place(rng: np.random.Generator) -> tuple[Float, Float, Float]:
    off, bound, covariance = _table(rng)
    return off[:2], bound[:2, :2], covariance[:2, :2]


def _axis_direction(rng: np.random.Generator) -> tuple[Float, Float, Float]:
    off, bound, covariance = _table(rng)
    return off[2:] / DEG, bound[2:, 2:] / DEG**2, covariance[2:, 2:] / DEG**2


def _table(rng: np.random.Generator) -> tuple[Float, Float, Float]:
    """Error (4,) of the axis across itself, where the stage tells its point, and in direction; bound, covariance."""
    markers = rng.normal(size=(MARKERS, 3)) * [200.0, 200.0, 100.0]
    angles = np.array(ANGLES_DEG) * DEG
    noisy = angles + ANGLE_NOISE_DEG * DEG * rng.normal(size=(MARKERS, len(angles)))
    rows = []
    for k, marker in enumerate(markers):
        for j, angle in enumerate(noisy[k]):
            at = ON_AXIS_MM + rotation_from_vector(angle * AXIS[None])[0] @ marker + NOISE_MM * rng.normal(size=3)
            rows.append(f"m{k},{ANGLES_DEG[j]:g}," + ",".join(f"{v:.9f}" for v in at))
    given = {"noise_mm": NOISE_MM, "angle_noise_deg": ANGLE_NOISE_DEG, "max_u_mm": 10.0}
    found = _asked(lambda path: turntable(marks=path, **given), "marker,angle_deg,x_mm,y_mm,z_mm", rows)
    point, direction, across = (np.array(found[key]) for key in ("axis_point_mm", "axis_direction", "across"))
    nearest = ON_AXIS_MM + (point - ON_AXIS_MM) @ AXIS * AXIS
    off = np.concatenate([across @ (point - nearest), across @ (direction - AXIS)])

    def told(x: Float) -> Float:
        """The markers' places with axis and markers moved by x, in standard deviations."""
        c, d = nearest + across.T @ x[:2], AXIS + across.T @ x[2:4]
        d = d / np.linalg.norm(d)
        out = []
        for marker, more in zip(markers, x[4:].reshape(-1, 3), strict=True):
            begun = ON_AXIS_MM + marker + more - c
            for angle in angles:
                turned = rotation_from_vector(angle * d[None])[0] @ begun
                sway = ANGLE_NOISE_DEG * DEG * np.cross(AXIS, turned)
                square = NOISE_MM**2 * np.eye(3) + np.outer(sway, sway)
                out.append(np.linalg.solve(np.linalg.cholesky(square), c + turned))
        return np.concatenate(out)

    bound = _bound(told, 4 + 3 * MARKERS, np.repeat([STEP, 1e-6, STEP], [2, 2, 3 * MARKERS]))[:4, :4]
    return off, bound, np.array(found["covariance"])


def _into(x: Float, used: Float, size: int) -> Float:
    out = np.zeros(size)
    out[used] = x
    return out


def _bound(told: Callable[[Float], Float], size: int, steps: Float | None = None) -> Float:
    """Inverse information (size, size) of what is told in standard deviations, by central differences."""
    steps = np.full(size, STEP) if steps is None else steps
    J = np.stack([(told(s * e) - told(-s * e)) / (2.0 * s) for s, e in zip(steps, np.eye(size), strict=True)], axis=1)
    return np.asarray(np.linalg.inv(J.T @ J))


def _asked(stage: Callable[[Path], Any], header: str, rows: list[str]) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
        return dict(json.loads(stage(path)[0].content))
