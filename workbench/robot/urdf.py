"""A robot out of its URDF: the chain by pin, the links' collision shapes from the file itself. URDF is in m and rad."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.children import read_by
from workbench.errors import InputError, nearest
from workbench.extras import Extra
from workbench.geometry.poses import inverse, mapped, pose_from, rotation_from_rpy
from workbench.robot.cell_model import Shape, read_mesh
from workbench.robot.kinematics import CONVENTIONAL, Bodies, Chain
from workbench.storage import regular_file
from workbench.strict_json import MAX_BYTES
from workbench.units import DEG, MM, Float

if TYPE_CHECKING:
    import pinocchio as pin
else:
    pin = Extra("pinocchio")

MAX_DEPTH = 64
EXPAND = Path(__file__).with_name("expand.py")  # run, not imported
XACRO, EXPANDED_S = re.compile(rb"<xacro:|\$[({]"), 30.0  # what no URDF holds
LEAST_RANGE = 0.2  # rad, the middle of six: in degrees made radians twice, 654 deg
MOST_SPEED = 30.0  # rad/s: the middle of six joints is slower in the fastest arms, and faster in deg/s in the slowest
UNLIKE = (
    8.0  # times the middle velocity: the fastest axis of an arm turns three times as fast, deg/s are 57 times rad/s
)
LEAST_SIZE_MM, MOST_SIZE_MM = 50.0, 2e4  # of an arm, along its joints
TURNS = 2  # of a continuous joint, either way: a cable allows for no more


def read_urdf(
    path: Path,
    base_frame: str,
    flange_frame: str,
    held: Mapping[str, float] | None = None,
    packages: Mapping[str, Path] | None = None,
    arguments: Mapping[str, str] | None = None,
) -> tuple[Chain, tuple[Shape, ...]]:
    """The chain between two frames of a six-axis robot, and its links' shapes, placed in the base at zero.

    Shapes carry their link's name and `link` 0 (does not move) to 6. A continuous joint is one of +-TURNS turns.

    Args:
        path: the URDF, or the xacro that one is made of.
        base_frame: in which poses are given.
        flange_frame: behind the sixth joint.
        held: joints that do not move, and where they stand: deg, or mm of a prismatic one (a linear track).
        packages: folders of ROS packages by name, for `package://name/...` and `$(find name)`; those around the file
            need not be named.
        arguments: of the xacro.

    Raises:
        InputError: no such file, not a URDF, not six revolute joints with limits, an unknown frame, a missing mesh; a
            mimic joint, or a prismatic one that is not held, by its name.
    """
    packages = packages_around(path) | dict(packages or {})
    document = _parsed(path, packages, arguments)
    stand = _mimicking(document, held or {}, path)
    _check_kinds(document, stand, flange_frame, path)
    model = _held(_built(document, path), document, stand, path)
    _check_joints(model, path)
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    base = _world_from(model, data, base_frame, path)
    flange = inverse(base) @ _world_from(model, data, flange_frame, path)
    if model.frames[_frame(model, flange_frame, path)].parentJoint != 6:
        raise InputError(f"{path}: {flange_frame}", "expected a flange frame behind the sixth joint")
    pin.computeJointJacobians(model, data, pin.neutral(model))
    points = np.array([data.oMi[i + 1].translation for i in range(6)]) * MM
    to_base = inverse(base)
    chain = Chain(
        name=str(model.name),
        joint_names=tuple(model.names)[1:],
        axes=data.J[3:].T @ to_base[:3, :3].T,
        points_mm=mapped(to_base, points),
        base_from_flange_at_zero=flange,
        limits=np.column_stack([model.lowerPositionLimit, model.upperPositionLimit]),
        speeds=np.array(model.velocityLimit),
        frames={
            name: to_base @ _world_from(model, data, name, path) for name in CONVENTIONAL if model.existFrame(name)
        },
        bodies=_bodies(model, data, to_base),
    )
    return chain, tuple(_shapes(document, model, data, to_base, packages, path))


def track_joint(
    path: Path,
    name: str,
    base_frame: str,
    packages: dict[str, Path],
    arguments: Mapping[str, str],
) -> tuple[Float, Float, float, frozenset[str]]:
    """A prismatic joint below the robot: direction (3,) of the base in itself, limits (2,) mm, mm/s, links before it.

    Raises:
        InputError: no such joint, another kind, without limits, or not below the base frame.
    """
    document = _parsed(path, packages_around(path) | packages, arguments)
    named = _joints(document)
    joint, where = named.get(name), f"{path}: {name!r}"
    if joint is None:
        raise InputError(where, f"unknown joint{nearest(name, named)} ($.track.joint)")
    if joint.get("type") != "prismatic":
        raise InputError(where, f"expected a prismatic joint in $.track.joint, found a {joint.get('type')} one")
    if name not in set(_towards(named, base_frame)):
        raise InputError(where, f"expected $.robot.base_frame to be carried by the track, found '{base_frame}'")
    model = _built(document, path)
    number, data = model.joints[model.getJointId(name)].idx_q, model.createData()
    places = []
    for metres in (0.0, 1.0):
        q = pin.neutral(model)
        q[number] = metres
        pin.forwardKinematics(model, data, q)
        places.append(_world_from(model, data, base_frame, path))
    limits = np.array([model.lowerPositionLimit[number], model.upperPositionLimit[number]]) * MM
    speed = float(model.velocityLimit[model.joints[model.getJointId(name)].idx_v]) * MM
    if not limits[0] < limits[1] or not speed > 0:
        raise InputError(where, "expected limits with lower < upper and a velocity above 0")
    direction = places[0][:3, :3].T @ (places[1] - places[0])[:3, 3] / MM
    before = {_link(named[one], "parent") for one in _towards(named, _link(joint, "child"))}
    return direction, limits, speed, frozenset(before)


def _bodies(model: pin.Model, data: pin.Data, to_base: Float) -> Bodies | None:
    """Masses of the links with what hangs on them; None where one of them has none."""
    placed = [place.act(inertia) for place, inertia in zip(data.oMi[1:], model.inertias[1:], strict=True)]
    turn, mass = to_base[:3, :3], np.array([one.mass for one in placed])
    if not (mass > 0).all():
        return None
    centre = np.array([one.lever for one in placed]) * MM @ turn.T + to_base[:3, 3]
    return Bodies(mass, centre, np.array([turn @ one.inertia @ turn.T for one in placed]))


def _joints(document: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """The joints by name."""
    return {joint.get("name", ""): joint for joint in document.iterfind("joint")}


def _towards(named: Mapping[str, ElementTree.Element], link: str) -> Iterator[str]:
    """Names of the joints from the root to a link, the last one first."""
    above = {_link(joint, "child"): (name, _link(joint, "parent")) for name, joint in named.items()}
    for _ in range(len(above)):  # pin refuses circles later
        if link in above:
            name, link = above[link]
            yield name


def _link(joint: ElementTree.Element, which: str) -> str:
    """Name of the link before ('parent') or behind a joint."""
    element = joint.find(which)
    return "" if element is None else element.get("link", "")


def _mimicking(document: ElementTree.Element, held: Mapping[str, float], path: Path) -> dict[str, float]:
    """Joints that stand, with those that mimic one of them: deg (+-180 of continuous ones), or mm."""
    stand, named = dict(held), _joints(document)
    kinds = {name: joint.get("type") for name, joint in named.items()}
    mimics = {name: mimic for name, joint in named.items() if (mimic := joint.find("mimic")) is not None}
    for _ in mimics:  # one may mimic another
        for name, mimic in mimics.items():
            master = mimic.get("joint", "")
            if name in stand or master not in stand:
                continue
            times, plus = (
                _numbers(mimic.get(key, default), 1, f"{path}: {name}")[0]
                for key, default in (("multiplier", "1"), ("offset", "0"))
            )
            unit, master_unit = (MM if kinds[one] == "prismatic" else 1 / DEG for one in (name, master))
            stand[name] = (times * stand[master] / master_unit + plus) * unit
    return {name: math.remainder(at, 360.0) if kinds.get(name) == "continuous" else at for name, at in stand.items()}


def _check_kinds(document: ElementTree.Element, held: Mapping[str, float], flange_frame: str, path: Path) -> None:
    """Refuse joints that are none of six by their names; continuous ones get limits, for pin to take them as others."""
    named = _joints(document)
    arm = set(_towards(named, flange_frame))
    for name in held:
        if name not in named:
            raise InputError(f"{path}: {name!r}", f"unknown joint{nearest(name, named)} ($.robot.held)")
    for name, joint in named.items():
        kind, where = joint.get("type"), f"{path}: {name}"
        if name in held and kind not in ("revolute", "continuous", "prismatic"):
            raise InputError(where, f"expected a joint that could move in $.robot.held, found a {kind} one")
        if joint.find("mimic") is not None and (name in arm or name not in held):
            raise InputError(
                where,
                "a mimic joint (a parallelogram or another linkage): expected six joints that turn "
                "by themselves" + ("" if name in arm else ", or this one in $.robot.held (or what it mimics)"),
            )
        if kind == "prismatic" and name not in held:
            raise InputError(
                where,
                "expected a revolute joint, found a prismatic one: a linear track stands where the "
                f'cell says, e.g. "held": {{"{name}": 1200}} in $.robot (mm), or moves: "track": {{"joint": "{name}"}}',
            )
        limit = joint.find("limit")
        if kind == "revolute" and not {"effort", "velocity"} <= set(() if limit is None else limit.keys()):
            limits = "expected <limit lower= upper= effort= velocity=>, in rad and rad/s: the robot's maker states them"
            raise InputError(where, limits)
        if limit is not None and _numbers(limit.get("velocity", "0"), 1, where)[0] < 0:
            raise InputError(where, "expected a limit with a velocity above 0")
        if kind == "continuous":
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            joint.set("type", "revolute")
            limit.set("lower", repr(-TURNS * 2 * np.pi))
            limit.set("upper", repr(TURNS * 2 * np.pi))
            limit.set("effort", limit.get("effort", "0"))
            limit.set("velocity", limit.get("velocity", "0"))


def _held(model: pin.Model, document: ElementTree.Element, held: Mapping[str, float], path: Path) -> pin.Model:
    """The model with some joints fixed where the cell says."""
    if not held:
        return model
    named, q = _joints(document), pin.neutral(model)
    for name, value in held.items():
        joint = model.joints[model.getJointId(name)]
        at = value / MM if named[name].get("type") == "prismatic" else value * DEG
        low, high = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
        if not low - 1e-9 <= at <= high + 1e-9:
            raise InputError(f"{path}: {name}", f"expected a place within its limits in $.robot.held, found {value:g}")
        q[joint.idx_q] = at
    return pin.buildReducedModel(model, [model.getJointId(name) for name in held], q)


def kinematic_model(path: Path) -> pin.Model:
    """pin's model of any robot; shapes and meshes are not looked at. Raises InputError for what is not a URDF."""
    return _built(_parsed(path, packages_around(path)), path)


def _built(document: ElementTree.Element, path: Path) -> pin.Model:
    with _quiet():
        try:
            return pin.buildModelFromXML(ElementTree.tostring(document, encoding="unicode"))
        except ValueError:
            raise InputError(str(path), "expected a URDF that pinocchio can build a robot from") from None


def _parsed(
    path: Path, packages: Mapping[str, Path], arguments: Mapping[str, str] | None = None
) -> ElementTree.Element:
    content = _content(path, "a URDF")
    xacro = XACRO.search(content)
    if xacro:
        content = _expanded(path, packages, arguments or {})
    elif arguments:
        raise InputError(str(path), "expected xacro, which takes arguments ($.robot.arguments), found none of its tags")
    root = _tree(path, "a URDF", content)
    if root.tag != "robot":
        raise InputError(str(path), f"expected a URDF (root element 'robot'), found '{root.tag}'")
    if xacro and root.find("link") is None:
        others = (one for one in sorted(path.parent.glob("*.xacro")) if one != path and one.is_file())
        users = [one.name for one in others if path.name.encode() in one.read_bytes()]
        raise InputError(
            str(path),
            "expected xacro that makes a robot, found macros that nothing calls: name the file that includes this one"
            + (f" ({', '.join(users)})" if users else ""),
        )
    return root


def _expanded(path: Path, packages: Mapping[str, Path], arguments: Mapping[str, str]) -> bytes:
    """The URDF that xacro makes of a file, in a process that can do nothing else."""
    request = {
        "packages": {name: str(folder.absolute()) for name, folder in packages.items()},
        "arguments": dict(arguments),
    }
    try:
        with read_by(str(EXPAND), path, "robot.urdf", EXPANDED_S, json.dumps(request)) as (status, said, out):
            if not status:
                return out.read_bytes()
    except subprocess.TimeoutExpired:
        said = ""
    why = said.strip() or "it takes more time or memory than a robot's"
    raise InputError(str(path), f"expected xacro that a URDF is made of: {why}")


def _content(path: Path, what: str) -> bytes:
    if regular_file(path).st_size > MAX_BYTES:
        raise InputError(str(path), f"expected {what} of at most {MAX_BYTES} bytes")
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from None


def _tree(path: Path, what: str, content: bytes | None = None) -> ElementTree.Element:
    try:
        parser = ElementTree.XMLParser(target=_Builder())
        return ElementTree.fromstring(_content(path, what) if content is None else content, parser)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(str(path), f"expected {what}: {error}") from None


def disabled_pairs(path: Path) -> dict[tuple[str, str], str]:
    """Pairs of links that an SRDF lets touch, and why it says so.

    Raises:
        InputError: no such file, or not an SRDF.
    """
    root = _tree(path, "an SRDF")
    found = {
        (pair.get("link1", ""), pair.get("link2", "")): pair.get("reason", "no reason")
        for pair in root.iterfind("disable_collisions")
    }
    if root.tag != "robot" or not found:
        raise InputError(str(path), "expected an SRDF: root element 'robot' with disable_collisions")
    return found


class _Builder(ElementTree.TreeBuilder):
    """Builds elements; a document type is refused, since its entities could grow without end or name other files."""

    depth = 0

    def start(self, tag: Any, attrs: Any) -> ElementTree.Element:
        """An element begins: what reads the document after this descends into it."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise ValueError(f"of at most {MAX_DEPTH} levels")
        return super().start(tag, attrs)

    def end(self, tag: str) -> ElementTree.Element:
        """An element ends."""
        self.depth -= 1
        return super().end(tag)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Called where one begins."""
        raise ValueError(f"without a document type, found '{name}'")


def _check_joints(model: pin.Model, path: Path) -> None:
    if model.nq != 6 or model.nv != 6 or model.njoints != 7:
        names = ", ".join(list(model.names)[1:])
        raise InputError(
            str(path),
            f"expected six revolute joints in a row, found {model.njoints - 1} joints: {names}; others (of a gripper) "
            "stand where $.robot.held says",
        )
    for i, joint in enumerate(model.joints[1:]):
        where, low, high = f"{path}: {model.names[i + 1]}", model.lowerPositionLimit[i], model.upperPositionLimit[i]
        if "JointModelR" not in joint.shortname() or model.parents[i + 1] != i:
            raise InputError(where, "expected a revolute joint, all six in one chain")
        if not low < high:
            raise InputError(where, "expected limits with lower < upper")
        # More than a continuous joint is given; axes 4 and 6 of some arms do turn many times.
        if i in (0, 1, 2, 4) and max(-low, high) > 1.01 * TURNS * 2 * np.pi:
            raise InputError(
                where, f"expected limits in radians, found {low:g}, {high:g}: degrees? Divide them by 57.3"
            )
        if not model.velocityLimit[i] > 0:
            raise InputError(where, "expected a limit with a velocity above 0")
    middle, speed = (
        float(np.median(model.upperPositionLimit - model.lowerPositionLimit)),
        model.velocityLimit,
    )
    if middle < LEAST_RANGE:
        raise InputError(
            str(path), f"expected limits in radians, the middle range of six is {middle:.3g}: divided by 57.3 twice?"
        )
    if np.median(speed) > MOST_SPEED:
        found = ", ".join(f"{value:g}" for value in speed)
        raise InputError(str(path), f"expected velocities in rad/s, found {found}: are they in deg/s?")
    for i, value in enumerate(speed):
        if not 1.0 / UNLIKE < value / np.median(speed) < UNLIKE:
            raise InputError(
                f"{path}: {model.names[i + 1]}",
                f"expected a velocity in rad/s like those of the other joints, found {value:g} (their middle is "
                f"{np.median(speed):g}): is its unit another?",
            )
    size = float(sum(np.linalg.norm(place.translation) for place in model.jointPlacements[2:])) * MM
    if not LEAST_SIZE_MM < size < MOST_SIZE_MM:
        raise InputError(str(path), f"expected lengths in metres, found {size / MM:.3g} m along the joints: in mm?")


def _frame(model: pin.Model, name: str, path: Path) -> int:
    """pin's index of a frame; its own getFrameId raises nothing for an unknown name."""
    if not model.existFrame(name):
        raise InputError(f"{path}: {name!r}", f"unknown frame{nearest(name, [f.name for f in model.frames])}")
    return int(model.getFrameId(name))


def _world_from(model: pin.Model, data: pin.Data, name: str, path: Path) -> Float:
    frame = model.frames[_frame(model, name, path)]
    placed = data.oMi[frame.parentJoint] * frame.placement
    return pose_from(np.array(placed.rotation), np.array(placed.translation) * MM)


def _shapes(
    document: ElementTree.Element,
    model: pin.Model,
    data: pin.Data,
    to_base: Float,
    packages: Mapping[str, Path],
    path: Path,
) -> Iterator[Shape]:
    """All collision shapes of all links; a cylinder named under collision_checking is a capsule, as pin has it."""
    for link in document.iter("link"):
        name = link.get("name", "")
        capsules = {mark.get("name") for mark in link.iterfind("collision_checking/capsule")}
        for collision in link.iterfind("collision"):
            where = f"{path}: link '{name}'"
            kind, size, vertices, triangles = _geometry(
                collision, collision.get("name") in capsules, where, packages, path
            )
            base_from_link = to_base @ _world_from(model, data, name, path)
            joint = int(model.frames[_frame(model, name, path)].parentJoint)
            yield Shape(name, joint, kind, size, base_from_link @ _origin(collision, where), vertices, triangles)


def _geometry(
    collision: ElementTree.Element, capsule: bool, where: str, packages: Mapping[str, Path], path: Path
) -> tuple[str, tuple[float, ...], Float | None, Float | None]:
    """Kind, sizes in mm, and a mesh's vertices and triangles."""
    geometry = collision.find("geometry")
    found = list(geometry) if geometry is not None else []
    if len(found) != 1:
        raise InputError(where, "expected one geometry in each collision element")
    element = found[0]
    if element.tag == "mesh":
        scale = _numbers(element.get("scale", "1 1 1"), 3, where)
        vertices, triangles = read_mesh(_file(element.get("filename", ""), packages, where, path), where)
        return "mesh", (), vertices * np.array(scale) * MM, triangles
    if element.tag == "box":
        return "box", tuple(MM * s for s in _numbers(element.get("size", ""), 3, where)), None, None
    radius = MM * _numbers(element.get("radius", ""), 1, where)[0]
    if element.tag == "sphere":
        return "sphere", (radius,), None, None
    if element.tag == "cylinder":
        length = MM * _numbers(element.get("length", ""), 1, where)[0]
        return "capsule" if capsule else "cylinder", (radius, length), None, None
    raise InputError(where, f"unknown geometry '{element.tag}': expected box, sphere, cylinder or mesh")


def _file(name: str, packages: Mapping[str, Path], where: str, path: Path) -> Path:
    """Of a mesh: relative to the URDF, in a package around it or that the cell knows, or in a folder of that name."""
    if not name.startswith("package://"):
        return path.parent / name.removeprefix("file://")
    package, _, rest = name.removeprefix("package://").partition("/")
    own = packages.get(package) or next((one for one in path.resolve().parents if one.name == package), None)
    if own is None:
        raise InputError(
            where,
            f"the mesh is in the package '{package}': expected its folder in the cell's "
            f"$.robot.packages{nearest(package, packages)}",
        )
    return own / rest


def packages_around(path: Path) -> dict[str, Path]:
    """Folders of ROS packages by the name in their package.xml, the nearest of a name.

    Around a file in a package: that, those beside it, and those of the repositories beside its own. Around another
    one: those below its folder.
    """
    regular_file(path)
    own = next((folder for folder in path.resolve().parents if (folder / "package.xml").is_file()), None)
    places = [path.resolve().parent] if own is None else [own.parent, own.parent.parent]
    found: dict[str, Path] = {}
    for manifest in (
        *([] if own is None else [own / "package.xml"]),
        *(one for place in places for shape in ("*", "*/*") for one in sorted(place.glob(f"{shape}/package.xml"))),
    ):
        try:
            name = _tree(manifest, "a ROS package's manifest").findtext("name", "").strip()
        except InputError:
            continue  # of another project: a package that is asked for is missed by its name
        found.setdefault(name, manifest.parent)
    return found


def _origin(collision: ElementTree.Element, where: str) -> Float:
    origin = collision.find("origin")
    if origin is None:
        return np.eye(4)
    x, y, z = _numbers(origin.get("xyz", "0 0 0"), 3, where)
    roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"), 3, where)  # URDF: Rz(yaw) Ry(pitch) Rx(roll)
    return pose_from(rotation_from_rpy(yaw, pitch, roll), np.array([x, y, z]) * MM)


def _numbers(text: str, count: int, where: str) -> list[float]:
    try:
        values = [float(part) for part in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not np.isfinite(values).all():
        raise InputError(where, f"expected {count} numbers, found {text!r}")
    return values


@contextmanager
def _quiet() -> Iterator[None]:
    """What the URDF parser prints from C++ is kept off standard error: errors are one line here."""
    sys.stderr.flush()
    saved, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nowhere)
