"""The shipped robot cell, and pinocchio's model of its robot."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from workbench.robot import Cell, Chain, forward_kinematics, read_cell
from workbench.robot.urdf import read_urdf
from workbench.units import Float

DATA = Path(__file__).parents[2] / "data" / "robot"
METRES = np.array([1e-3] * 3 + [1.0] * 3)[:, None]


class Pin:
    """Forward kinematics and Jacobian by pinocchio, in m and rad."""

    def __init__(self, urdf: Path) -> None:
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.data = self.model.createData()
        self.flange = self.model.getFrameId("tool0")

    def forward(self, q: Float) -> Float:
        pin.framesForwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMf[self.flange].homogeneous)

    def jacobian(self, q: Float, point_m: Float) -> Float:
        """Of a point of the flange, base axes."""
        frame = pin.Frame(
            "p",
            6,
            self.flange,
            self.model.frames[self.flange].placement * pin.SE3(np.eye(3), point_m),
            pin.FrameType.OP_FRAME,
        )
        model = self.model.copy()
        index = model.addFrame(frame)
        return np.array(pin.computeFrameJacobian(model, model.createData(), q, index, pin.LOCAL_WORLD_ALIGNED))


def missing(chain: Chain, joints: Float, poses: Float) -> Float:
    """Largest entry of what branches (..., b, 6) miss of poses (..., 4, 4), m and 1; NaN where there is no branch."""
    difference = forward_kinematics(chain, np.nan_to_num(joints)) - poses[..., None, :, :]
    difference[..., :3, 3] /= 1e3
    return np.where(np.isnan(joints[..., 0]), np.nan, np.abs(difference).max(axis=(-1, -2)))


def apart(a: Float, b: Float) -> Float:
    """Largest difference of angles (..., 6), a turn being nothing."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


def plainly(tree: Any) -> None:
    """The shipped cell without clearance, envelope, uncertainty and process, and the cutter a part of the tool."""
    del tree["uncertainty"], tree["robot"]["acceleration_deg_s2"], tree["tool"]["shapes"][2]["body"], tree["envelope"]
    del tree["process"], tree["turntable"]["acceleration_deg_s2"]
    tree["margin_mm"] = 0


@pytest.fixture(scope="session")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Cell:
    tree = json.loads((DATA / "cell.json").read_text())
    plainly(tree)
    tree["robot"]["urdf"] = str(DATA / tree["robot"]["urdf"])
    file = tmp_path_factory.mktemp("plain") / "cell.json"
    file.write_text(json.dumps(tree))
    return read_cell(file)


@pytest.fixture(scope="session")
def chain(cell: Cell) -> Chain:
    return cell.chain


@pytest.fixture(scope="session")
def arms(chain: Chain) -> Callable[[str], Chain]:
    """`arms(name)`: the shipped robot, or one of tests/robot/urdf."""

    def named(name: str) -> Chain:
        if name == "irb6700":
            return chain
        return read_urdf(Path(__file__).parent / "urdf" / f"{name}.urdf", "base_link", "tool0")[0]

    return named


@pytest.fixture(scope="session")
def by_pin() -> Pin:
    return Pin(DATA / "irb6700_150_320.urdf")


@pytest.fixture
def postures(chain: Chain) -> Callable[[int, int], Float]:
    """`postures(count, seed)`: random joint angles within limits."""

    def draw(count: int, seed: int) -> Float:
        rng = np.random.default_rng(seed)
        return rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (count, 6))

    return draw


@pytest.fixture
def cell_file(tmp_path: Path) -> Callable[..., Path]:
    """`cell_file(change)`: a copy of the shipped cell, changed as a JSON tree."""

    def write(change: Callable[[Any], Any] = lambda tree: None) -> Path:
        tree = json.loads((DATA / "cell.json").read_text())
        change(tree)
        (tmp_path / "irb6700_150_320.urdf").write_bytes((DATA / "irb6700_150_320.urdf").read_bytes())
        (tmp_path / "cell.json").write_text(json.dumps(tree))
        return tmp_path / "cell.json"

    return write
