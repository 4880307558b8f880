"""A cell's base and flange against those of its maker's controllers: by robots whose frames public packages have."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.program.postured import DATA, ROBOTS, URDFS
from workbench.artefacts import Judgement, ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.robot import forward_kinematics, read_cell
from workbench.robot.judge import judge

TOOL = np.array([[0, 0, 1, 260], [0, -1, 0, 0], [1, 0, 0, 140], [0, 0, 0, 1]], float)
MAKERS = {"abb": "irb6700", "kuka": "kr210", "fanuc": "m20ia", "ur": "ur10e", "yaskawa": "gp25"}


def frame(name: str, parent: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    """A frame of a URDF, fixed to another one."""
    return (
        f'<link name="{name}"/><joint name="{parent}-{name}" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )


def told(
    folder: Path, maker: str, change: Callable[[Any], None] = lambda _: None, urdf: Callable[[str], str] = str
) -> Judgement:
    """What is said of a program in the maker's language that begins in a posture and moves the tool by 10 mm."""
    base_frame, posture_deg = ROBOTS[MAKERS[maker]]
    source = DATA / "irb6700_150_320.urdf" if maker == "abb" else URDFS / f"{MAKERS[maker]}.urdf"
    (folder / "robot.urdf").write_text(urdf(source.read_text()))
    tree: dict[str, Any] = {
        "format": "robot-cell",
        "version": 1,
        "robot": {"urdf": "robot.urdf", "base_frame": base_frame},
        "controller": {"dialect": maker},
        "tool": {"flange_from_cutter": TOOL.tolist()},
    }
    change(tree)
    (folder / "cell.json").write_text(json.dumps(tree))
    cell = read_cell(folder / "cell.json")
    stands = np.radians(posture_deg)
    pose = forward_kinematics(cell.chain, stands) @ cell.flange_from_cutter
    pose[:3, 3] -= 10 * pose[:3, 2]
    moves = (
        ProgramMove(1, "J", "t", "base", joints=stands),
        ProgramMove(2, "L", "t", "base", pose=pose, feed_mm_s=20.0),
    )
    return judge(
        cell,
        ProgramMoves(maker, "p", moves, {"t": ProgramTool(cell.flange_from_cutter)}, {"base": np.eye(4)}),
    )


def base(name: str, world: Sequence[float] | None = None) -> Callable[[Any], None]:
    """Another base frame, and where the controller has its base in it."""

    def change(tree: Any) -> None:
        tree["robot"]["base_frame"] = name
        tree["controller"]["world_from_base"] = world and {"position_mm": list(world)}

    return change


def flange(name: str) -> Callable[[Any], None]:
    return lambda tree: tree["robot"].update(flange_frame=name)


def added(*frames: str) -> Callable[[str], str]:
    return lambda text: text.replace("</robot>", "".join(frames) + "</robot>")


def moved_base(xyz: str = "0 0 0", rpy: str = "0 0 0") -> tuple[Callable[[Any], None], Callable[[str], str]]:
    return base("here"), added(frame("here", "base_link", xyz, rpy))


def moved_flange(xyz: str = "0 0 0", rpy: str = "0 0 0") -> tuple[Callable[[Any], None], Callable[[str], str]]:
    return flange("here"), added(frame("here", "tool0", xyz, rpy))


def as_shipped(tree: Any) -> None:
    """Nothing is changed."""


def as_in_ros(text: str) -> str:
    """UR's package has the arm behind a base_link that is turned by 180 deg against the controller's base."""
    root = frame("arm", "base_link", rpy="0 0 3.141592653589793").replace(
        '<link name="arm"/>', '<link name="base_link"/>'
    )
    return added(root)(text.replace('"base_link"', '"arm"'))


def unnamed(text: str) -> str:
    """No frame has its conventional name."""
    return text.replace('"base"', '"world_of_the_pendant"')


def other_sense(joint: str) -> Callable[[str], str]:
    """A joint of the URDF counts the other way."""

    def turned(text: str) -> str:
        head, mark, rest = text.partition(f'<joint name="{joint}"')
        before, axis, behind = rest.partition('<axis xyz="')
        numbers, quote, end = behind.partition('"')
        back = " ".join(str(-float(number)) for number in numbers.split())
        return head + mark + before + axis + back + quote + end

    return turned


WRONG: dict[str, tuple[str, Callable[[Any], None], Callable[[str], str], str]] = {
    "fanuc, base at the floor": ("fanuc", base("base_link"), str, r"525\.0 mm.*\"base_frame\": \"base\""),
    "fanuc, the same without a name": ("fanuc", base("base_link"), unnamed, r"525\.0 mm.*xyz=\"0 0 0.525\""),
    "fanuc, the axes of another world": ("fanuc", *moved_base("0 0 0.525", "0 0 1.5708"), r"90\.00 deg apart"),
    "fanuc, flange of REP-199": ("fanuc", *moved_flange(rpy="0 -1.5707963 3.1415927"), r"\"flange_frame\": \"tool0\""),
    "fanuc, joint 3 as ABB counts it": ("fanuc", as_shipped, other_sense("joint_3"), r"than FANUC's .*: 3;"),
    "yaskawa, base at the floor": ("yaskawa", base("base_link"), str, r"505\.0 mm.*\"base_frame\": \"base\""),
    "yaskawa, flange turned by 180": ("yaskawa", *moved_flange(rpy="0 0 3.14159265"), r"180\.00 deg"),
    "ur, base_link of ROS": ("ur", base("base_link"), as_in_ros, r"180\.00 deg apart.*\"base_frame\": \"base\""),
    "ur, flange of REP-199": ("ur", *moved_flange(rpy="-1.5707963 -1.5707963 0"), r"120\.00 deg.*flange_frame"),
    "kuka, base on a pedestal": ("kuka", *moved_base("0 0 -0.4"), r"400\.0 mm.*world_from_base"),
    "kuka, joint 1 as ABB counts it": ("kuka", as_shipped, other_sense("joint_1"), r"than KUKA's"),
    "kuka, zero of axis 2 upright": (
        "kuka",
        as_shipped,
        lambda text: text.replace('xyz="0.35 0 0" rpy="0 0 0"', 'xyz="0.35 0 0" rpy="0 -1.5707963267948966 0"'),
        "than KUKA's",
    ),
    "abb, base at axis 2": ("abb", *moved_base("0 0 0.78"), r"780\.0 mm.*\"base_frame\": \"base_link\""),
    "abb, another world than stated": (
        "abb",
        base("here", (0, 0, 390)),
        added(frame("here", "base_link", "0 0 -0.4")),
        r" 10\.0 mm",
    ),
    "fanuc, a world that it has not": ("fanuc", base("base", (0, 0, 525)), str, "expected null, programs of FANUC's"),
    "ur robot at an ABB": ("abb", as_shipped, lambda _: (URDFS / "ur10e.urdf").read_text(), "than ABB's"),
}


@pytest.mark.parametrize("case", WRONG)
def test_no_program_is_released_in_a_frame_that_is_not_the_controllers(tmp_path: Path, case: str) -> None:
    maker, cell, urdf, message = WRONG[case]
    (fault,) = told(tmp_path, maker, cell, urdf).violations
    assert fault.kind == "frame"
    assert re.search(message, fault.finding), fault.finding


@pytest.mark.parametrize("down", [False, True])
def test_a_robot_that_hangs_has_its_controllers_world_for_base_frame(tmp_path: Path, down: bool) -> None:
    """There a turntable's z points up, though it points down in the robot's own base."""
    turned = {"quaternion_wxyz": [0, 1, 0, 0]}

    def change(tree: Any) -> None:
        base("here")(tree)
        tree["controller"]["world_from_base"] = {"position_mm": [0, 0, 3000], **turned}
        place = {"position_mm": [2500, 0, 500], **(turned if down else {})}
        tree["turntable"] = {"base_from_turntable": place, "speed_deg_s": 30}

    found = told(tmp_path, "abb", change, added(frame("here", "base_link", "0 0 3", "3.141592653589793 0 0")))
    assert not found.violations
    assert any("its z points down" in text for text in found.unchecked) == down


@pytest.mark.parametrize("unit", ["tool", "urdf", "turntable", "home", "work object"])
def test_cells_in_other_units_are_not_even_read(tmp_path: Path, unit: str) -> None:
    """In metres and radians, where the file has mm and deg; the URDF in mm."""
    metres = {"position_mm": [2.0, 0, 0.5]}
    changes: dict[str, Callable[[Any], None]] = {
        "tool": lambda tree: tree["tool"].update(flange_from_cutter={"position_mm": [0.26, 0, 0.14]}),
        "turntable": lambda tree: tree.update(turntable={"base_from_turntable": metres}),
        "home": lambda tree: tree.update(process={"home": {"joints_deg": np.radians(ROBOTS["irb6700"][1]).tolist()}}),
        "work object": lambda tree: tree.update(work_object={"pose": metres}),
    }
    in_mm = str if unit != "urdf" else lambda text: text.replace('xyz="0.32 0 ', 'xyz="320 0 ')
    with pytest.raises(InputError, match=r"metres|radians|in mm"):
        told(tmp_path, "abb", changes.get(unit, as_shipped), in_mm)


def test_a_world_that_the_controller_knows_is_released(tmp_path: Path) -> None:
    """On a pedestal; and a calibrated robot, whose axes miss the rule by a hair."""
    stated = told(tmp_path, "kuka", base("here", (-100, 0, 400)), added(frame("here", "base_link", "0.1 0 -0.4")))
    assert stated.violations == ()
    by_a_hair = told(tmp_path, "ur", urdf=lambda text: text.replace('xyz="0 0 0.1807"', 'xyz="0.0004 0 0.1812"'))
    assert by_a_hair.violations == ()


def test_what_only_the_cell_file_says_is_told(tmp_path: Path) -> None:
    """The height of a KUKA's base where no frame has its name."""
    nameless = told(tmp_path, "kuka", base("foot"), lambda text: text.replace('"base_link"', '"foot"'))
    assert nameless.violations == ()
    assert any("base's height on axis 1" in said for said in nameless.unchecked)
