"""`scan.read` on good files in each form, and on every kind of bad one."""

from __future__ import annotations

import contextlib
import os
import random
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from bench.fuzz.recordings import mutated_recording
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.scan import read

Build = Callable[..., Path]
Edit = Callable[[Any], None]


def replace(path: str, values: Any, **how: Any) -> Edit:
    """Another data set in the place of one."""

    def edit(file: Any) -> None:
        if path in file:
            del file[path]
        file.create_dataset(path, data=values, **how)

    return edit


def change(path: str, where: Any, value: Any) -> Edit:
    """Another value in a data set."""

    def edit(file: Any) -> None:
        values = file[path][()]
        values[where] = value
        file[path][...] = values

    return edit


def attribute(name: str, value: Any, holder: str = "/") -> Edit:
    def edit(file: Any) -> None:
        if value is None:
            del file[holder].attrs[name]
        else:
            file[holder].attrs[name] = value

    return edit


def delete(*paths: str) -> Edit:
    def edit(file: Any) -> None:
        for path in paths:
            del file[path]

    return edit


def every(*edits: Edit) -> Edit:
    def edit(file: Any) -> None:
        for one in edits:
            one(file)

    return edit


def sphere(file: Any) -> None:
    file.create_group("sphere").attrs["diameter_mm"] = 25.4


PACKED = {"compression": "gzip", "shuffle": True}
FORMS = {
    "contiguous": {},
    "chunked": {"chunks": (5, 3)},
    "chunk of all frames": {"chunks": (12, 1)},
    "resizable": {"maxshape": (None, None)},
    "gzip": {"compression": "gzip", "chunks": (5, 7)},
    "gzip and shuffle": PACKED | {"chunks": (5, 7)},
    "one chunk": PACKED | {"chunks": (12, 7)},
    "a frame a chunk": PACKED | {"chunks": (1, 7)},
    "chunks across frames": PACKED | {"chunks": (5, 4)},
    "with checksums": PACKED | {"chunks": (5, 7), "fletcher32": True},
    "lzf": {"compression": "lzf"},
}


FIELDS: dict[str, tuple[str, type]] = {
    "time_s": ("/profiles/time", np.float64),
    "x_mm": ("/profiles/x", np.float32),
    "z_mm": ("/profiles/z", np.float32),
    "intensity": ("/profiles/intensity", np.uint16),
    "pass_index": ("/profiles/pass", np.int64),
    "robot_time_s": ("/robot/time", np.float64),
    "robot_position_mm": ("/robot/position", np.float64),
    "robot_quaternion_wxyz": ("/robot/quaternion_wxyz", np.float64),
    "robot_pass": ("/robot/pass", np.int64),
    "flange_from_profiler": ("/hand_eye/flange_from_profiler", np.float64),
}


def assert_is(good: dict[str, Any], got: Recording) -> None:
    for name, (path, dtype) in FIELDS.items():
        values = getattr(got, name)
        assert values.dtype == dtype
        assert not values.flags.writeable
        np.testing.assert_array_equal(values, good[path].astype(dtype))


@pytest.mark.parametrize("storage", FORMS.values(), ids=FORMS)
def test_a_good_recording_in_each_form(build: Build, good: dict[str, Any], storage: dict[str, Any]) -> None:
    path = build(**storage)
    got = read(recording=path)
    assert_is(good, got)
    assert (got.source, got.part.part_id, got.clock, got.sphere_diameter_mm) == (str(path), "A-7", "robot", None)


def chunk(first: int, content: bytes, filter_mask: int = 0) -> Edit:
    """Bytes in the place of a chunk of five frames of z."""
    return lambda file: file["/profiles/z"].id.write_direct_chunk((first, 0), content, filter_mask=filter_mask)


def packed_as(dtype: str) -> Edit:
    """Another number format of z, in chunks of other frames than those of x."""
    return lambda file: replace("/profiles/z", file["/profiles/z"][()], dtype=dtype, chunks=(4, 7), **PACKED)(file)


def test_other_numbers_chunks_and_a_chunk_without_its_filters_are_read(build: Build, good: dict[str, Any]) -> None:
    unfiltered = chunk(5, good["/profiles/z"][5:10].tobytes(), filter_mask=3)
    for edit in (packed_as("<f4"), packed_as(">f4"), unfiltered):
        assert_is(good, read(recording=build(edit, **FORMS["gzip and shuffle"])))
    good["/profiles/z"] = good["/profiles/z"].astype("f2")
    assert_is(good, read(recording=build(packed_as("f2"), **FORMS["gzip and shuffle"])))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"not deflated", "incorrect header check"),
        (zlib.compress(bytes(5 * 7 * 4))[:-6], "expected a chunk of 140 bytes, found [0-9]+ without an end"),
        (zlib.compress(bytes(5 * 7 * 4))[:-1], "found 140 without an end"),  # its checksum is cut off
        (zlib.compress(bytes(10)), "found 10$"),
        (zlib.compress(bytes(10**6)), "found 141"),  # unpacked no further than that
    ],
)
def test_a_damaged_chunk_is_refused(build: Build, content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=rf"part\.h5: expected a complete HDF5 file: /profiles/z\[5\]: .*{message}"):
        read(recording=build(chunk(5, content), **FORMS["gzip and shuffle"]))


def test_blocks_of_frames_make_up_the_whole(
    build: Build, good: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workbench.scan.read_stage.BLOCK_BYTES", 4 * 7 * 5)
    seen: list[float] = []
    got = read(recording=build(), progress=seen.append)
    np.testing.assert_array_equal(got.z_mm, good["/profiles/z"])
    assert seen == [5 / 12, 10 / 12, 1.0]


def one_pass(file: Any) -> None:
    delete("/profiles/pass", "/robot/pass")(file)
    replace("/profiles/time", np.arange(12) * 0.01)(file)
    replace("/robot/time", np.array([0.0, 0.05, 0.1, 0.11]))(file)


def optional_absent(file: Any) -> None:
    one_pass(file)
    delete("/profiles/intensity", "/hand_eye")(file)
    del file.attrs["part_id"]


def test_what_is_optional_may_be_absent(build: Build) -> None:
    got = read(recording=build(optional_absent))
    assert got.intensity is None
    assert got.flange_from_profiler is None
    assert got.part.part_id is None
    assert not got.pass_index.any()
    assert not got.robot_pass.any()


GOOD = {
    "big-endian": replace("/robot/position", np.ones((4, 3), ">f8")),
    "x in float64": replace("/profiles/x", np.ones((12, 7))),
    "pass in int64": replace("/profiles/pass", np.tile([-5, 70], 6)),
    "one pass, named by the profiles only": every(one_pass, replace("/profiles/pass", np.full(12, 7, np.int32))),
    "one pass, named by the robot only": every(one_pass, replace("/robot/pass", np.full(4, -3, np.int32))),
    "a hand-eye group without a pose": delete("/hand_eye/flange_from_profiler"),
    "text as bytes": attribute("format", np.bytes_(b"profile-recording")),
    "version in an array": attribute("version", np.array([1], np.uint8)),
    "more than the format says": replace("/notes/temperature", [20.5]),
    "soft link within the file": every(
        lambda f: f.move("/profiles/x", "/store"), lambda f: f.__setitem__("/profiles/x", h5py.SoftLink("/./store"))
    ),
    "times at both ends of the poses": change("/profiles/time", -2, 0.1),
    "quaternion a little off unit length": change("/robot/quaternion_wxyz", (0, 0), 1.0009),
    "a frame without any return": change("/profiles/x", 4, np.nan),
    "held-still repeats of a sphere": every(
        sphere,
        replace("/robot/time", [3.0, 4.0]),
        replace("/robot/position", np.zeros((2, 3))),
        replace("/robot/quaternion_wxyz", [[1.0, 0, 0, 0]] * 2),
        replace("/robot/pass", np.array([-5, 70], np.int32)),
    ),
    "own clock of a sphere": every(
        sphere, attribute("clock", "own", "/profiles"), lambda f: f["/profiles/time"].write_direct(np.arange(12) + 1e6)
    ),
}


@pytest.mark.parametrize("edit", GOOD.values(), ids=GOOD)
def test_what_the_format_allows_is_read(build: Build, edit: Edit) -> None:
    got = read(recording=build(edit))
    np.testing.assert_allclose(np.linalg.norm(got.robot_quaternion_wxyz, axis=1), 1, atol=1e-15)


def test_names_out_of_the_file_can_always_be_printed(build: Build) -> None:
    def edit(file: Any) -> None:
        kind = h5py.string_dtype("utf-8", 4)
        file.attrs.create("part_id", np.array(b"a\xff\x80b", "S4"), dtype=kind)

    part_id = read(recording=build(edit)).part.part_id
    assert part_id is not None
    part_id.encode("utf-8")


def external_link(file: Any) -> None:
    delete("/profiles/x")(file)
    file["/profiles/x"] = h5py.ExternalLink("other.h5", "/x")


def external_group(file: Any) -> None:
    file.move("/robot", "/elsewhere")
    file["/robot"] = h5py.ExternalLink("other.h5", "/robot")


def soft_link_through_an_external_one(file: Any) -> None:
    delete("/profiles/x")(file)
    file["/out"] = h5py.ExternalLink("other.h5", "/")
    file["/profiles/x"] = h5py.SoftLink("/out/x")


def circular_link(file: Any) -> None:
    delete("/profiles/x")(file)
    file["/profiles/x"] = h5py.SoftLink("/profiles/x")


def external_storage(file: Any) -> None:
    delete("/profiles/x")(file)
    file.create_dataset("/profiles/x", (12, 7), "f4", external=[("raw.bin", 0, 336)])


def virtual(file: Any) -> None:
    delete("/profiles/x")(file)
    source = h5py.VirtualLayout((12, 7), "f4")
    source[:] = h5py.VirtualSource("other.h5", "x", (12, 7))
    file.create_virtual_dataset("/profiles/x", source)


def unwritten(shape: tuple[int, ...], **how: Any) -> Edit:
    """A data set that declares `shape` and holds nothing."""

    def edit(file: Any) -> None:
        delete("/profiles/z")(file)
        file.create_dataset("/profiles/z", shape, "f4", **how)

    return edit


def one_chunk_of_many(file: Any) -> None:
    unwritten((12, 7), chunks=(5, 7))(file)
    file["/profiles/z"][:5] = 200.0


def bomb(file: Any) -> None:
    """All chunks written, but 20 MB of zeros in 300 bytes, deflated twice: no recording compresses like that."""
    delete("/profiles/x", "/profiles/z", "/profiles/intensity", "/profiles/time", "/profiles/pass")(file)
    twice = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    twice.set_chunk((1, 2**20))
    twice.set_deflate(9)
    twice.set_deflate(9)
    for name in (b"x", b"z"):
        space = h5py.h5s.create_simple((5, 2**20))
        made = h5py.Dataset(h5py.h5d.create(file["/profiles"].id, name, h5py.h5t.IEEE_F32LE, space, twice))
        made[...] = 0
    replace("/profiles/time", np.arange(5) / 50)(file)
    replace("/profiles/pass", np.full(5, -5, np.int32))(file)


IMPROPER = np.diag([1.0, 1.0, -1.0, 1.0])
BAD: dict[str, tuple[Edit, str]] = {
    "no format": (attribute("format", None), "/@format"),
    "other format": (attribute("format", "point-cloud"), "expected 'profile-recording', found 'point-cloud'"),
    "later version": (attribute("version", 2), "/@version"),
    "version as text": (attribute("version", "1"), "/@version"),
    "metres": (attribute("length_unit", "m"), "expected 'mm', found 'm'"),
    "milliseconds": (attribute("time_unit", "ms"), "expected 's', found 'ms'"),
    "format is a number": (attribute("format", 3.5), "/@format"),
    "part_id is an array": (attribute("part_id", [1.0, 2.0]), "/@part_id"),
    "no profiles": (lambda f: f.move("/profiles", "/profile"), "did you mean 'profile'"),
    "no x": (lambda f: f.move("/profiles/x", "/profiles/X"), "/profiles/x: no such data set"),
    "no robot time": (delete("/robot/time"), "/robot/time"),
    "misspelt quaternion": (
        lambda f: f.move("/robot/quaternion_wxyz", "/robot/quaternion_xyzw"),
        "did you mean 'quaternion_xyzw'",
    ),
    "misspelt hand-eye": (
        lambda f: f.move("/hand_eye/flange_from_profiler", "/hand_eye/flange_to_profiler"),
        "did you mean 'flange_to_profiler'",
    ),
    "group for a data set": (every(delete("/profiles/x"), lambda f: f.create_group("/profiles/x")), "found a group"),
    "data set for a group": (every(delete("/robot"), replace("/robot", 3)), "/robot/time"),
    "time in two dimensions": (replace("/profiles/time", np.zeros((12, 1))), "expected 1 dimensions"),
    "x in one dimension": (replace("/profiles/x", np.zeros(12, "f4")), "/profiles/x: expected 2 dimensions"),
    "null data space": (
        every(delete("/profiles/x"), lambda f: f.__setitem__("/profiles/x", h5py.Empty("f4"))),
        "/profiles/x",
    ),
    "fewer times than frames": (replace("/profiles/time", np.arange(11) / 100), "expected 11 along axis 0"),
    "x wider than z": (replace("/profiles/x", np.zeros((12, 8), "f4")), "expected 8 along axis 1 as in /profiles/x"),
    "intensity of other frames": (replace("/profiles/intensity", np.zeros((3, 7), "u2")), "/profiles/intensity"),
    "a pass too few": (replace("/profiles/pass", np.zeros(11, "i4")), "/profiles/pass"),
    "positions in a plane": (replace("/robot/position", np.zeros((4, 2))), "expected 3 along axis 1"),
    "quaternions by column": (replace("/robot/quaternion_wxyz", np.zeros((4, 3))), "expected 4 along axis 1"),
    "hand-eye 3 x 4": (replace("/hand_eye/flange_from_profiler", np.eye(4)[:3]), "/hand_eye/flange_from_profiler"),
    "x as text": (replace("/profiles/x", np.full((12, 7), b"1.0", "S3")), "expected floating-point numbers"),
    "x as objects": (
        replace("/profiles/x", np.full((12, 7), "1", object), dtype=h5py.string_dtype()),
        "expected floating-point numbers",
    ),
    "x as integers": (replace("/profiles/x", np.zeros((12, 7), "i4")), "expected floating-point numbers"),
    "times as complex": (replace("/profiles/time", np.arange(12) * 1j), "expected floating-point numbers"),
    "pass as floats": (replace("/profiles/pass", np.zeros(12)), "expected integers"),
    "intensity signed": (replace("/profiles/intensity", np.zeros((12, 7), "i2")), "expected unsigned integers"),
    "external link": (external_link, "a link that leaves it"),
    "external group": (external_group, "a link that leaves it"),
    "soft link through an external one": (soft_link_through_an_external_one, "a link that leaves it"),
    "circular link": (circular_link, "leads nowhere"),
    "dangling link": (
        every(delete("/profiles/x"), lambda f: f.__setitem__("/profiles/x", h5py.SoftLink("/no"))),
        "/profiles/x: no such data set",
    ),
    "external storage": (external_storage, "virtual or external storage"),
    "virtual data set": (virtual, "virtual or external storage"),
    "a terabyte that was never written": (unwritten((250_000, 1_000_000), chunks=(1000, 1000)), "declares"),
    "a terabyte, contiguous": (unwritten((250_000, 1_000_000)), "declares"),
    "never written": (unwritten((12, 7)), "of which the file holds 0"),
    "half of it never written": (one_chunk_of_many, "declares 3 chunks, of which the file lacks 2"),
    "far too well compressed": (bomb, "can hold"),
    "no frames": (
        every(
            *(replace(f"/profiles/{n}", np.zeros((0, 7), "f4")) for n in "xz"), replace("/profiles/time", np.zeros(0))
        ),
        "is empty",
    ),
    "no columns": (every(*(replace(f"/profiles/{n}", np.zeros((12, 0), "f4")) for n in "xz")), "is empty"),
    "all NaN": (change("/profiles/z", ..., np.nan), "no return in any frame"),
    "infinite x": (change("/profiles/x", (7, 2), np.inf), "/profiles/x[7, 2]"),
    "infinite z": (change("/profiles/z", (9, 0), -np.inf), "/profiles/z[9, 0]"),
    "a code for no return": (change("/profiles/z", (9, 0), -3.4e38), "/profiles/z[9, 0]"),
    "NaN time": (change("/profiles/time", 3, np.nan), "/profiles/time[3]"),
    "time in nanoseconds since 1970": (change("/robot/time", 1, 1.7e18), "/robot/time[1]"),
    "zero quaternion": (change("/robot/quaternion_wxyz", 2, 0), "/robot/quaternion_wxyz[2]"),
    "quaternion off unit length": (change("/robot/quaternion_wxyz", (0, 0), 1.0011), "/robot/quaternion_wxyz[0]"),
    "NaN position": (change("/robot/position", (2, 1), np.nan), "/robot/position[2, 1]"),
    "NaN quaternion": (change("/robot/quaternion_wxyz", (2, 1), np.nan), "/robot/quaternion_wxyz[2, 1]"),
    "pose time that stands": (change("/robot/time", 3, 0.0), "/robot/time[3]"),
    "time that stands": (
        change("/profiles/time", 4, 0.02),
        "/profiles/time[4]: expected times that rise within pass -5",
    ),
    "frame before the poses": (
        change("/profiles/time", 0, -1e-6),
        "/profiles/time[0]: expected a time within the poses",
    ),
    "frame in the gap to another pass": (change("/profiles/time", 10, 50.0), "of pass -5"),
    "postures held still, without the sphere": (
        every(
            replace("/robot/time", [100.0, 0.0]),
            *(lambda f, name=name: replace(name, f[name][::2])(f) for name in ("/robot/position", "/robot/pass")),
            lambda f: replace("/robot/quaternion_wxyz", f["/robot/quaternion_wxyz"][::2])(f),
        ),
        "is /sphere missing?",
    ),
    "pass without poses": (change("/profiles/pass", 11, 71), "pass 71 has no robot poses"),
    "passes on one side only": (
        every(delete("/robot/pass"), replace("/robot/time", [0.0, 0.1, 100.0, 100.1])),
        "/profiles/pass[0]",
    ),
    "mirrored hand-eye": (replace("/hand_eye/flange_from_profiler", IMPROPER), "expected a rigid motion"),
    "NaN hand-eye": (change("/hand_eye/flange_from_profiler", (0, 3), np.nan), "rigid motion"),
    "unknown clock": (attribute("clock", "sensor", "/profiles"), "expected 'robot' or 'own'"),
    "clock as number": (attribute("clock", 1, "/profiles"), "/profiles@clock"),
    "sphere without diameter": (lambda f: f.create_group("sphere"), "/sphere@diameter_mm"),
    "sphere of no size": (every(sphere, attribute("diameter_mm", 0.0, "/sphere")), "/sphere@diameter_mm"),
    "sphere as text": (every(sphere, attribute("diameter_mm", "25.4", "/sphere")), "/sphere@diameter_mm"),
}


@pytest.mark.parametrize(("edit", "expected"), BAD.values(), ids=BAD)
def test_bad_recordings_are_refused_with_file_and_place(build: Build, edit: Edit, expected: str) -> None:
    path = build(edit)
    with pytest.raises(InputError) as caught:
        read(recording=path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert expected in message
    assert "\n" not in message


def test_an_external_file_is_not_even_opened(build: Build, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "other.h5")  # opening it would wait for ever
    with pytest.raises(InputError, match="leaves it"):
        read(recording=build(external_link))


def single_frame(file: Any) -> None:
    for name in ("time", "x", "z", "intensity", "pass"):
        replace(f"/profiles/{name}", file[f"/profiles/{name}"][:1])(file)


def test_a_single_frame_will_do_for_a_sphere_alone(build: Build) -> None:
    with pytest.raises(InputError, match="a single frame"):
        read(recording=build(single_frame))
    assert len(read(recording=build(every(single_frame, sphere))).time_s) == 1


@pytest.mark.parametrize("kept", [0, 7, 8, 100, 2048, 0.5, 0.99])
def test_a_truncated_file_is_refused(build: Build, kept: float) -> None:
    path = build(chunks=(5, 3))
    os.truncate(path, int(kept * path.stat().st_size) if 0 < kept < 1 else int(kept))
    with pytest.raises(InputError, match=r"expected a complete HDF5 file|is empty: was it exported"):
        read(recording=path)


def test_other_files_are_refused(build: Build, tmp_path: Path) -> None:
    text, pipe = tmp_path / "text.h5", tmp_path / "pipe.h5"
    text.write_text("x;z\n1,5;2,5\n")
    os.mkfifo(pipe)
    build()
    for path, expected in (
        (text, "expected a complete HDF5 file"),
        (pipe, "not a directory or a device"),
        (tmp_path, "not a directory or a device"),
        (tmp_path / "prat.h5", "no such file; did you mean 'part.h5'?"),
        (tmp_path / "none" / "part.h5", "no such file"),
        (text / "part.h5", "cannot be opened"),
    ):
        with pytest.raises(InputError) as caught:
            read(recording=path)
        assert str(caught.value).startswith(f"{path}: ")
        assert expected in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_is_refused(build: Build) -> None:
    path = build()
    path.chmod(0)
    with pytest.raises(InputError, match="permission denied"):
        read(recording=path)


@pytest.mark.parametrize("what", ["unlink", "truncate", "append"])
def test_a_recording_that_vanishes_or_changes_half_way_is_refused(
    build: Build, what: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = build(chunks=(1, 7))
    monkeypatch.setattr("workbench.scan.read_stage.BLOCK_BYTES", 4)

    def interfere(fraction: float) -> None:
        if fraction < 0.3:
            return
        if what == "unlink":
            path.unlink(missing_ok=True)
        elif what == "truncate":
            os.truncate(path, 3000)
        else:
            with path.open("ab") as file:
                file.write(b"more")

    with pytest.raises(InputError) as caught:
        read(recording=path, progress=interfere)
    assert str(caught.value).startswith(f"{path}: ")


def test_changed_numbers_give_a_recording_or_an_input_error(build: Build) -> None:
    path, rng = build(), random.Random(4)
    content = path.read_bytes()
    for _ in range(40):
        path.write_bytes(mutated_recording(content, ".h5", rng))
        with contextlib.suppress(InputError):
            got = read(recording=path)
            assert np.isfinite(got.robot_position_mm).all()
            assert not np.isinf(got.x_mm).any()
