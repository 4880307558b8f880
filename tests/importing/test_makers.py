"""Makers' files: written here in their form, and real ones where they are at hand."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import skimage.io

from tests.importing import makers
from workbench.artefacts import Recording
from workbench.cli import main
from workbench.errors import InputError

AXIS = {"linear_axis": {"direction": [0, 1, 0], "speed_mm_s": 50}}
EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "other_forms.py"
Import = Callable[..., Recording]
Mapped = Callable[..., Path]


def assert_is_the_plate(made: Recording, z_offset_mm: float = 0.0, z_error_mm: float = 0.0) -> None:
    want = makers.heights_mm()
    np.testing.assert_allclose(made.z_mm, want - z_offset_mm, atol=1e-5 + z_error_mm)  # NaN where NaN
    seen = ~np.isnan(want)
    np.testing.assert_allclose(made.x_mm[seen], np.broadcast_to(makers.X_MM, want.shape)[seen], atol=1e-6)
    np.testing.assert_allclose(made.robot_position_mm[:, 1], makers.TRAVEL_MM, atol=1e-9)
    np.testing.assert_allclose(made.time_s, makers.TRAVEL_MM / 50.0)


def test_scancontrol_points_stand_in_their_columns(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    """Points without return are left out of the file; the gaps in x give the columns back."""
    assert_is_the_plate(imported(makers.write_scancontrol(tmp_path / "a.csv"), mapping=mapped(**AXIS)))


def test_gocator_surface(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    assert_is_the_plate(imported(makers.write_gocator(tmp_path / "a.csv"), mapping=mapped(**AXIS)))


def test_surfaces_of_one_file_are_passes(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    made = imported(makers.write_gocator(tmp_path / "a.csv", surfaces=2), mapping=mapped(**AXIS))
    np.testing.assert_array_equal(made.pass_index, np.repeat([0, 1], makers.FRAMES))
    np.testing.assert_array_equal(made.z_mm[: makers.FRAMES], made.z_mm[makers.FRAMES :])


def test_gopxl_files_are_frames_in_the_order_given(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    files = [makers.write_gopxl(tmp_path / f"{i}.csv", i) for i in range(makers.FRAMES)]
    made = imported(*files, mapping=mapped(**AXIS, times={"source": "pose_each", "pitch_mm": makers.STEP_MM}))
    assert_is_the_plate(made)
    assert made.intensity is not None
    np.testing.assert_array_equal(made.intensity[3], 100 + np.arange(makers.COLUMNS))


def test_a_keyence_profile_by_a_mapping(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    """Whole numbers of 0.01 micrometres between tabs; codes for no return in the mapping (docs/importing.md)."""
    files = [tmp_path / f"{i}.txt" for i in range(makers.FRAMES)]
    for file, row in zip(files, makers.heights_mm() - 80.0, strict=True):
        z = [-2147483648 if np.isnan(one) else round(one * 1e5) for one in row]
        file.write_text("".join(f"{round(x * 1e5)}\t{v}\r\n" for x, v in zip(makers.X_MM, z, strict=True)))
    part = {"delimiter": "\t", "header": False, "length_unit": "0.01um", "frames": "one", "columns": {"x": 0, "z": 1}}
    part["missing"] = [-2147483648, -2147483647, -2147483646, -2147483645]
    times = {"source": "pose_each", "pitch_mm": makers.STEP_MM}
    made = imported(*files, mapping=mapped(**AXIS, profiles={"files": "*.txt", **part}, times=times))
    assert_is_the_plate(made, z_offset_mm=80.0)


@pytest.mark.parametrize("file", ["a.tif", "g.csv", "a.bin"])
def test_other_forms_become_arrays(file: str, tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    """By the examples of the page, to which their refusal points."""
    path, unit, forms = tmp_path / file, 1e5, runpy.run_path(str(EXAMPLE))
    x, z, y = makers.X_MM, makers.heights_mm(), makers.TRAVEL_MM
    pitches = makers.PITCH_MM, makers.STEP_MM
    if file == "g.csv":
        table = np.block([[np.zeros((1, 1)), x[None]], [y[:, None], np.nan_to_num(z, nan=-999.999)]])
        path.write_text("y/x" + "\n".join(",".join(f"{one:.6f}" for one in row) for row in table)[8:])
        made = forms["grid"](path)
    elif file == "a.tif":
        skimage.io.imsave(path, np.rint(np.nan_to_num(z) / 0.002).astype("<u2"), check_contrast=False)
        made = forms["heights"](skimage.io.imread(path), 0, 0.002, x[0], *pitches)
    else:
        np.nan_to_num(np.rint((z - 80.0) / 8e-4) + 32768, nan=0).astype("<u2").tofile(path)
        made = forms["keyence"](path, makers.COLUMNS, 80, x[0] * unit, pitches[0] * unit, pitches[1])
    with pytest.raises(InputError, match="#other-forms"):
        imported(path)
    arrays = tmp_path / "scan.npz"
    np.savez(arrays, **dict(zip(("x", "z", "travel"), made, strict=True)))
    offset_mm = 80.0 if file == "a.bin" else 0.0
    assert_is_the_plate(imported(arrays, mapping=mapped(**AXIS)), offset_mm, 0.0011)


def test_whole_numbers_of_any_type_are_intensity(
    tmp_path: Path, imported: Import, mapped: Mapped, capsys: pytest.CaptureFixture[str]
) -> None:
    file, arrays = tmp_path / "a.npz", {"x": makers.X_MM, "z": makers.heights_mm(), "travel": makers.TRAVEL_MM}
    for light, is_kept in ((np.int32(700), True), (np.float32(0.5), False), (np.int32(-1), False)):
        np.savez(file, **arrays, intensity=np.full(arrays["z"].shape, light))
        got = imported(file, mapping=mapped(**AXIS)).intensity
        assert (got is not None and bool((got == 700).all())) == is_kept
        assert main(["import", str(file), "--mapping", str(mapped(**AXIS)), "--out", str(tmp_path / "a.h5")]) == 0
        assert ("intensity = intensity (left out" in capsys.readouterr().out) != is_kept


def swapped(path: Path, old: str, new: str) -> Path:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, 1).encode())
    return path


REFUSED: dict[str, tuple[Callable[[Path], Path], str, str, str]] = {
    "a number that is none": (makers.write_scancontrol, "-4,500", "-4,5x0", r"line 1, cell 3: expected a number"),
    "a point for a comma": (
        makers.write_scancontrol,
        "-4,500",
        "-4.500",
        r"cell 3: expected a number with decimal mark ','",
    ),
    "y that changes": (makers.write_scancontrol, "0,500;0,500", "0,500;0,700", r"line 9: expected one y"),
    "a row too short": (makers.write_scancontrol, ";80,100;", ";", r"line \d+: expected \d+ numbers as in x"),
    "another version": (makers.write_gocator, "2,1,0", "1,1,0", r"line 3: expected CSV Version 2, found '1'"),
    "a row too many": (makers.write_gocator, f",{makers.FRAMES},", ",5,", r"line \d+: expected 'End' after 5 rows"),
    "rows beyond the end": (makers.write_gocator, f",{makers.FRAMES},", ",999999,", r"expected row 7 of 999999"),
    "no column count": (makers.write_gocator, f",{makers.COLUMNS},", ",,", r"expected 'Row Count' and 'Column Count'"),
    "an infinity": (makers.write_gocator, "80.05000", "inf", r"cell \d+: expected a finite number, found 'inf'"),
    "no y": (makers.write_gocator, "\n0.00000,", "\n,", r"line 15: expected a coordinate"),
    "valid 2": (makers.write_gopxl, ",100,1", ",100,2", r"line 2: column 'Valid': expected a whole number from 0 to 1"),
    "intensity": (makers.write_gopxl, ",105,", ",70000,", r"line 7: column 'Intensity': expected a whole number"),
    "a cell lost": (makers.write_gopxl, ",105,", ",", r"line 7: expected 5 cells, found 4"),
    "an index again": (makers.write_gopxl, "\n5,", "\n4,", r"line 7: column 'Index': expected a number that rises"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_damage_is_named_by_line(case: str, tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    write, old, new, message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        imported(swapped(write(tmp_path / "a.csv"), old, new), mapping=mapped(**AXIS))
    assert not (tmp_path / "imported.h5").exists()


def test_of_several_bad_rows_the_first_is_named(tmp_path: Path, imported: Import, mapped: Mapped) -> None:
    path = makers.write_gopxl(tmp_path / "a.csv")
    path.write_text(path.read_text().replace(",1\n", ",2\n"))
    with pytest.raises(InputError, match=r"line 2: column 'Valid': expected a whole number"):
        imported(path, mapping=mapped(**AXIS))
