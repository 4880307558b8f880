"""An outsider looks at a written program: true surface, pinocchio and fcl; nothing of the product's own checks."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import pinocchio as pin
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from workbench.program.rapid import Module
from workbench.robot import read_cell

from .paths import targets as targets_of


def pose(document: Any) -> np.ndarray:
    """The 4x4 matrix of a pose in a cell file."""
    if isinstance(document, list):
        return np.array(document, float)
    made = np.eye(4)
    made[:3, :3] = Rotation.from_quat(document.get("quaternion_wxyz", [1, 0, 0, 0]), scalar_first=True).as_matrix()
    made[:3, 3] = document.get("position_mm", [0, 0, 0])
    return made


def solid(shape: dict[str, Any]) -> fcl.CollisionGeometry:
    if "box_mm" in shape:
        return fcl.Box(*shape["box_mm"])
    if "sphere_mm" in shape:
        return fcl.Sphere(shape["sphere_mm"])
    kind = fcl.Capsule if "capsule_mm" in shape else fcl.Cylinder
    return kind(*shape.get("capsule_mm", shape.get("cylinder_mm")))


class Judge:
    """The robot from its URDF, the cell from its file, the finished surface from the truth."""

    def __init__(self, cell: Path, truth: Path, root_mm: float, bevel_deg: float) -> None:
        self.file, self.cell = cell, json.loads(cell.read_text())
        urdf = cell.parent / self.cell["robot"]["urdf"]
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.data = self.model.createData()
        self.tip = pose(self.cell["tool"]["flange_from_cutter"])
        self.links = [
            (link.get("name"), self._placed(c))
            for link in ElementTree.parse(urdf).getroot().iter("link")
            for c in link.findall("collision")
        ]
        self.truth = {
            k: np.array(v, float)
            for k, v in json.loads(truth.read_text()).items()
            if k in ("position_mm", "normal", "across", "tangent")
        }
        self.root_mm, self.bevel = root_mm, np.radians(bevel_deg)

    def _placed(self, collision: ElementTree.Element) -> tuple[np.ndarray, fcl.CollisionGeometry]:
        origin, shape = collision.find("origin"), next(iter(collision.find("geometry")))
        made = np.eye(4)
        made[:3, :3] = Rotation.from_euler("xyz", [float(x) for x in origin.get("rpy").split()]).as_matrix()
        made[:3, 3] = 1e3 * np.array([float(x) for x in origin.get("xyz").split()])
        if shape.tag == "box":
            return made, fcl.Box(*(1e3 * float(x) for x in shape.get("size").split()))
        return made, fcl.Capsule(1e3 * float(shape.get("radius")), 1e3 * float(shape.get("length")))

    def frame(self, name: str) -> np.ndarray:
        placed = self.data.oMf[self.model.getFrameId(name)].homogeneous.copy()
        placed[:3, 3] *= 1e3
        return placed

    def _stand(self, joints_deg: list[float]) -> np.ndarray:
        pin.framesForwardKinematics(self.model, self.data, np.radians(joints_deg))
        return np.linalg.inv(self.frame("base_link")) @ self.frame("tool0")

    def judge(self, out: Path, radius_mm: float, flute_mm: float) -> list[str]:
        """Everything that is wrong with the program in a folder of results."""
        posture = json.loads((out / "posture.json").read_text())
        rows = posture["points"] + posture["travels"]
        faults, targets = [], []
        program = Module(read_cell(self.file)).program({"BevelPath.mod": (out / "BevelPath.mod").read_text()})
        flange_from_tool = program.tools[program.moves[0].tool].flange_from_tool
        for row in rows:
            flange = self._stand(row["joints_deg"])
            targets.append((flange @ flange_from_tool)[:3, 3])
            faults += self._limits(row) + self._hits(flange, np.radians(row["turntable_deg"]))
            faults += self._below(flange, np.radians(row["turntable_deg"]), radius_mm, flute_mm)
        last = -1 if self.cell.get("process") else None  # the last target is the retract
        away = cKDTree(np.array(targets)).query(targets_of(program)[0][:last])[0]
        faults += [f"a target lies {away.max():.3f} mm from every posture"] if away.max() > 0.02 else []
        return faults

    def _limits(self, row: dict[str, Any]) -> list[str]:
        q = np.radians(row["joints_deg"])
        inside = (q >= self.model.lowerPositionLimit - 1e-6) & (q <= self.model.upperPositionLimit + 1e-6)
        low, high = self.cell["turntable"]["limits_deg"]
        good = inside.all() and low - 1e-6 <= row["turntable_deg"] <= high + 1e-6
        return [] if good else [f"beyond limits: {row}"]

    def _table(self, angle: float) -> np.ndarray:
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_rotvec([0, 0, angle]).as_matrix()
        return pose(self.cell["turntable"]["base_from_turntable"]) @ turn

    def _hits(self, flange: np.ndarray, angle: float) -> list[str]:
        """Tool, wrist and forearm against the turntable and what stands around."""
        base = np.linalg.inv(self.frame("base_link"))
        moving = [(n, base @ self.frame(n) @ at, g) for n, (at, g) in self.links if n in ("link_4", "link_5", "link_6")]
        moving += [("tool", flange @ pose(s["pose"]), solid(s)) for s in self.cell["tool"]["shapes"]]
        standing = [
            ("turntable", self._table(angle) @ pose(s["pose"]), solid(s)) for s in self.cell["turntable"]["shapes"]
        ]
        standing += [(s["name"], pose(s["pose"]), solid(s)) for s in self.cell["fixtures"]]
        return [f"{a[0]} hits {b[0]}" for a in moving for b in standing if _touch(a, b)]

    def _below(self, flange: np.ndarray, angle: float, radius: float, flute: float) -> list[str]:
        """Whether the cutter beside the edge is below the finished bevel of the true part."""
        back = self._table(0.0) @ np.linalg.inv(self._table(angle)) @ flange @ self.tip
        middle = back[:3, 3] - flute / 2 * back[:3, 2]
        low = self.truth["position_mm"]
        i = int(np.argmin(np.linalg.norm(low - middle, axis=1)))
        n, m, t = (self.truth[k][i] for k in ("normal", "across", "tangent"))
        if i in (0, len(low) - 1) and abs((middle - low[i]) @ t) > 1:
            return []  # beyond the part
        b = n * np.cos(self.bevel) + m * np.sin(self.bevel)
        above = (middle - low[i] - self.root_mm * m) @ b - radius
        return [] if above > -0.15 else [f"the cutter is {-above:.3f} mm below the finished bevel"]


def _touch(a: Any, b: Any) -> bool:
    objects = [fcl.CollisionObject(g, fcl.Transform(at[:3, :3], at[:3, 3])) for _, at, g in (a, b)]
    return bool(fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()))
