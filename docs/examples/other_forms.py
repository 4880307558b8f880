"""Other forms as arrays for `workbench import`: np.savez("scan.npz", x=x, z=z, travel=y), in mm, NaN for no return."""

import csv
import re
from pathlib import Path

import numpy as np


def heights(values, code, z_pitch, x_start, x_pitch, y_pitch):
    """x (M,), z (N, M), y (N,) of a height map, as skimage.io.imread has a TIFF or PNG; `code` (often 0): no return."""
    z = np.where(values == code, np.nan, values * z_pitch)
    return x_start + x_pitch * np.arange(z.shape[1]), z, y_pitch * np.arange(len(z))


def grid(file, codes=(-999.999,)):
    """The same of a CSV with x in the first row and y in the first column."""
    table = np.genfromtxt(file, delimiter=",")
    z = table[1:, 1:]
    return table[0, 1:], np.where(np.isin(z, codes), np.nan, z), table[1:, 0]


def keyence(file, columns, z_unit, x_start, x_pitch, y_pitch):
    """The same of Keyence's raw heights; z_unit, x_start and x_pitch in 0.01 um, y_pitch in mm."""
    values = np.fromfile(file, "<u2").reshape(-1, columns)
    z = np.where(values == 0, np.nan, (values - 32768.0) * z_unit * 1e-5)
    return (x_start + x_pitch * np.arange(columns)) * 1e-5, z, y_pitch * np.arange(len(z))


def sick(file, columns=1024):
    """x and z (N, M) of SICK's .dat, whose .xml lists the fields: FLOAT f4, WORD u2, INT i4, BYTE u1."""
    fields = [("x", "<f4", columns), ("r", "<f4", columns), ("mark", "<i4", 5), ("i", "u1", columns)]
    rows = np.fromfile(file, fields)
    return rows["x"], np.where((rows["x"] == 0) & (rows["r"] == 0), np.nan, rows["r"])


def kuka_rsi(text, file):
    """Telegrams of KUKA's RSI as a table of poses: X, Y, Z, A, B, C, and the time in ms."""
    found = re.findall(
        r'RIst X="(.*?)" Y="(.*?)" Z="(.*?)" A="(.*?)" B="(.*?)" C="(.*?)".*?<IPOC>(\d+)', text, re.DOTALL
    )
    _write(file, ["X", "Y", "Z", "A", "B", "C", "ipoc"], found)


def kuka_program(text, file):
    """Taught positions of a KUKA program as a table of poses, one a profile: `times.source` is `pose_each`."""
    _write(
        file,
        ["X", "Y", "Z", "A", "B", "C"],
        re.findall(r",? ?".join(rf"{name} ?([-+.\deE]+)" for name in "XYZABC"), text),
    )


def _write(file, head, rows):
    with Path(file).open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows([head, *rows])
