"""Forces of a dynamometer: units, delimiters, and what is refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.force_file import read_forces, recognises, summary

HEAD = ["DynoWare,Version 2.5.1.2", "Sampling rate [Hz]:,1000", "Time,Fx,Fy", "s,N,kN"]


def export(folder: Path, rows: list[str], head: list[str] = HEAD) -> Path:
    path = folder / "forces.csv"
    path.write_text("\n".join([*head, *rows, ""]))
    return path


def test_channels_come_in_newtons(tmp_path: Path) -> None:
    time = np.arange(500) / 1000.0
    rows = [f"{t:.4f},{30 + 8 * np.sin(2 * np.pi * 50 * t):.6f},0.002" for t in time]
    found = read_forces(export(tmp_path, rows))
    assert recognises("\n".join(HEAD))
    assert found.channel == ("Fx", "Fy")
    assert found.unit == ("N", "N")
    assert found.rate_hz == pytest.approx(1000.0)
    assert found.value[:, 1] == pytest.approx(np.full(500, 2.0))
    assert "mean 30 N" in summary(found)[1]
    assert "strongest at 50 Hz" in summary(found)[1]


def test_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    head = [line.replace(",", ";") for line in HEAD]
    found = read_forces(export(tmp_path, ["0,000;1,5;0", "0,001;2,5;0"], head))
    assert found.value[:, 0].tolist() == [1.5, 2.5]


@pytest.mark.parametrize(
    ("rows", "head"),
    [
        (["0,1,2"], HEAD),
        (["0,1,2", "0,1,2"], HEAD),
        (["0,1,2", "1,x,2"], HEAD),
        (["0,1,2", "1,,2"], HEAD),
        (["0,1,2", "1,2,3"], HEAD[:2]),
        (["0,1,2", "1,2,3"], [*HEAD[:3], "s,lbf,N"]),
        (["0,1,2", "1,2,3"], [*HEAD[:2], "Time,Fx,Fx", "s,N,N"]),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path: Path, rows: list[str], head: list[str]) -> None:
    with pytest.raises(InputError) as error:
        read_forces(export(tmp_path, rows, head))
    assert "\n" not in str(error.value)
