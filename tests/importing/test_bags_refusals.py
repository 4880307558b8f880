"""A bag that leaves a question open, or is damaged, ends in one line that names the place and what was expected."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import get_types_from_msg

from tests.importing.bag_files import CLOUD, JOINTS, KINDS, POSE, TF, TRANSFORM, Entry, Kind, Ros
from workbench.errors import InputError
from workbench.importing import bags
from workbench.importing.mapping import Mapping

X = np.linspace(-0.01, 0.01, 8).astype("f4")
Q = np.array([1.0, 0, 0, 0])
ROS = Ros("mcap")


def clouds(topic: str = "/profiles", frame: str = "laser", ros: Ros = ROS, count: int = 3) -> list[Entry]:
    return [(topic, CLOUD, k, ros.cloud(1.0 + k, {"x": X, "z": X + np.float32(0.2)}, frame)) for k in range(count)]


def poses(topic: str = "/flange", name: str = POSE, ros: Ros = ROS, **frames: str) -> list[Entry]:
    return [(topic, name, k, ros.pose(name, 1.0 + k, np.array([1.0, 0.01 * k, 1.0]), Q, **frames)) for k in range(3)]


def refused(path: Path, said: str, **bag: Any) -> str:
    mapping = Mapping.model_validate({"format": "import-mapping", "version": 1, "bag": bag})
    with pytest.raises(InputError, match=said) as caught:
        bags.read(path, mapping)
    assert str(caught.value).startswith(str(path))
    assert len(str(caught.value).splitlines()) == 1
    return str(caught.value)


CHOICE = r"choose from /left \(PointCloud2, 3\), /right \(PointCloud2, 3\)$"


def test_several_candidates_are_listed(tmp_path: Path) -> None:
    path = ROS.write(tmp_path / "bag", [*clouds("/left"), *clouds("/right"), *poses()])
    refused(path, CHOICE)
    refused(path, "no such topic .*did you mean '/left'", profiles=["/lft"])
    refused(path, "expected sensor_msgs/msg/PointCloud2", profiles=["/flange"])
    refused(path, "expected different topics", profiles=["/left", "/left"])
    joints: Entry = ("/joint_states", JOINTS, 1, ROS.joints(1.0, {"a": 0.0}))
    moving: Entry = ("/tf", TF, 1, ROS.tf(ROS.pose(TRANSFORM, 1.0, np.ones(3), Q)))
    path = ROS.write(tmp_path / "poses", [*clouds(), *poses(), joints, moving])
    refused(
        path, r"choose from /flange \(PoseStamped, 3\), /joint_states \(JointState, 1\), 'tf' \(/tf \(TFMessage, 1\)\)"
    )
    refused(path, r"/profiles: expected .*PoseStamped.*\(\$\.bag\.poses\), found", poses="/profiles")
    refused(path, r"/joint_states: expected \$\.bag\.urdf, base_frame and flange_frame", poses="/joint_states")
    refused(
        path, r"/tf: expected \$\.bag\.base_frame and flange_frame in the mapping; frames: base_link, tool0", poses="tf"
    )


def test_a_bag_of_other_things_names_them(tmp_path: Path) -> None:
    message = ROS.make("std_msgs/String", data="hello")
    path = ROS.write(tmp_path / "bag", [("/chatter", "std_msgs/msg/String", 1, message)])
    refused(path, r"expected topics of profiles or poses, found /chatter \(std_msgs/msg/String\)")
    refused(ROS.write(tmp_path / "empty", []), "expected a bag with messages")


def test_frames_of_messages_must_be_one(tmp_path: Path) -> None:
    path = ROS.write(tmp_path / "clouds", [*clouds(), *clouds(frame="other")])
    refused(path, r"/profiles\[3\]: expected frame_id 'laser', found 'other'|/profiles\[1\]")
    path = ROS.write(tmp_path / "poses", [*clouds(), *poses(parent="base")[:1], *poses(parent="world")[1:]])
    refused(path, r"/flange\[1\]: expected frame 'base', found 'world'")
    path = ROS.write(tmp_path / "named", [*clouds(), *poses(name=TRANSFORM, child="tcp")])
    refused(path, r"/flange\[0\]: expected frame 'tool0', found 'tcp'", flange_frame="tool0")


@pytest.mark.parametrize("kind", KINDS)
def test_a_header_without_time_asks_for_the_message_time(tmp_path: Path, kind: Kind) -> None:
    ros = Ros(kind)
    entries = [("/p", CLOUD, k + 1, ros.cloud(0.0, {"x": X, "z": X})) for k in range(2)]
    path = ros.write(tmp_path / ("b.bag" if kind == "rosbag1" else "b"), entries)
    refused(path, r'/p\[0\]: the header has no time: expected "time": "message"')


def test_poses_that_are_none(tmp_path: Path) -> None:
    for name, position, q, said in [
        ("nan", np.array([np.nan, 0, 0]), Q, r"/flange\[0\]: expected numbers for position and orientation"),
        ("zero", np.ones(3), 0 * Q, r"/flange: orientation\[0\]: expected a norm of 1 within 0.001, found 0"),
    ]:
        entry: Entry = ("/flange", POSE, 1, ROS.pose(POSE, 1.0, position, q))
        refused(ROS.write(tmp_path / name, [*clouds(), entry]), said)
    twice: list[Entry] = [("/flange", POSE, k, ROS.pose(POSE, 1.0, np.full(3, k), Q)) for k in range(2)]
    refused(ROS.write(tmp_path / "twice", [*clouds(), *twice]), r"/flange: two different poses at 1\.0 s")


def test_points_that_are_none(tmp_path: Path) -> None:
    far: Entry = ("/p", CLOUD, 1, ROS.cloud(1.0, {"x": X, "z": X + np.float32(1e30)}))
    refused(ROS.write(tmp_path / "far", [far]), r"/p\[0\]: expected coordinates of at most 1000 m, found 1e\+30")
    nothing: Entry = ("/p", CLOUD, 1, ROS.cloud(1.0, {"x": X, "z": X * np.float32(np.nan)}))
    refused(ROS.write(tmp_path / "nothing", [nothing]), "expected returns in the profiles, found none")
    empty: Entry = ("/p", CLOUD, 1, ROS.cloud(1.0, {"x": X[:0], "z": X[:0]}))
    refused(ROS.write(tmp_path / "empty", [empty]), "expected profiles with points, found none")
    refused(
        tmp_path / "far", "expected .*lateral and .*range to be different axes, found z, -z", lateral="z", range="-z"
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_type_with_a_strange_definition_is_refused(tmp_path: Path, kind: Kind) -> None:
    """Same name, other fields: its bytes would be taken for something else."""
    ros = Ros(kind)
    header = "std_msgs/Header header\n"
    types = get_types_from_msg(f"{header}geometry_msgs/Point where\ngeometry_msgs/Quaternion turn\nfloat64 extra", POSE)
    del ros.store.fielddefs[POSE]
    ros.store.register(types)
    message = ros.store.types[POSE](
        header=ros.header(1.0, "base"),
        extra=1.0,
        where=ros.make("geometry_msgs/Point", x=1.0, y=0.0, z=0.0),
        turn=ros.make("geometry_msgs/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
    )
    path = ros.write(tmp_path / ("b.bag" if kind == "rosbag1" else "b"), [("/flange", POSE, 1, message)])
    refused(path, r"/flange: expected the standard definition of geometry_msgs/msg/PoseStamped")


def test_files_that_are_no_bags(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.bag", "a.db3"):
        for content in (
            b"",
            b"x",
            b"\x89MCAP0\r\n",
            b"#ROSBAG V2.0\n",
            b"#ROSBAG V1.2\n",
            b"SQLite format 3\0" + bytes(100),
        ):
            (tmp_path / name).write_bytes(content)
            refused(tmp_path / name, "expected a readable bag")
    path = ROS.write(tmp_path / "bag", clouds())
    mcap = next(path.glob("*.mcap"))
    mcap.rename(tmp_path / "profiles.dat")
    assert bags.recognises(
        tmp_path / "profiles.dat", (tmp_path / "profiles.dat").read_bytes(), Mapping.model_construct()
    )
    refused(tmp_path / "profiles.dat", "expected a bag to be named .mcap, .bag, .db3")
    refused(path, "files are missing")
    (path / "metadata.yaml").unlink()
    refused(path, "expected metadata.yaml beside the storage")


def test_a_database_that_was_not_closed_is_refused(tmp_path: Path) -> None:
    ros = Ros("sqlite3")
    path = ros.write(tmp_path / "bag", clouds(ros=ros))
    Path(f"{next(path.glob('*.db3'))}-wal").write_bytes(b"messages")
    refused(path, "never put into the bag")
    refused(ros.write(tmp_path / "part7", clouds(ros=ros)).rename(tmp_path / "part#7"), "expected a path without")


def test_a_bag_that_has_lost_messages_is_refused(tmp_path: Path) -> None:
    import sqlite3

    ros = Ros("sqlite3")
    path = ros.write(tmp_path / "bag", clouds(ros=ros))
    with sqlite3.connect(next(path.glob("*.db3"))) as connection:
        connection.execute("DELETE FROM messages WHERE id = 2")
    connection.close()
    refused(path, "/profiles: expected 3 messages, found 2: the bag is damaged")
