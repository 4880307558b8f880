"""`python -m bench.open.real FOLDER`: real recordings, unsealed; skipped where they are not. No truth is beside them.

What references can tell: a sphere's stated radius is held against the one that a fit finds when it is left free; a
groove that one setting cut has corners on smooth courses, so what neighbouring rows differ by is repeatability, in
counts. Neither tells a hand-eye pose's or a groove size's error.
"""

from __future__ import annotations

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np

from workbench import scan
from workbench.look import look
from workbench.plugins import calibration

SPHERE, GROOVE = "sphere_r12.7.h5", "real/vgroove_lds_scan1.csv"
FREE_MM = 5.0  # what the radius is told to: nothing
RADIUS_MM = 12.7


def sphere(path: Path) -> str:
    """Radius left free, against the stated one."""
    read = scan.read(recording=path)
    found = calibration.hand_eye(calibration.circles(read), read, sphere_radius_u_mm=FREE_MM, max_u_mm=10.0)[1]
    off = found.sphere_radius_mm - RADIUS_MM
    return (
        f"| {SPHERE} | radius, mm | {RADIUS_MM} stated | off by {off:+.3f}; residuals {found.residual_rms_mm:.3f} rms |"
    )


def groove(path: Path) -> str:
    """Standard deviation of a corner in a row, from second differences of rows."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder, "corners.csv")
        look(str(path), None, None, str(table))
        with table.open(newline="") as file:
            rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name != "row"]
    values = np.array([[float(row[name]) for name in names] for row in rows])
    bends = np.diff(values, n=2, axis=0) / 6**0.5
    spread = 1.4826 * np.median(np.abs(bends), axis=0)
    told = ", ".join(f"{name} {s:.2f}" for name, s in zip(names, spread, strict=True))
    return f"| {GROOVE} | sd of a row, counts | smooth courses | {told} |"


def main(folder: Path) -> int:
    print("| file | quantity | reference | found |\n| --- | --- | --- | --- |")
    for name, told in ((SPHERE, sphere), (GROOVE, groove)):
        print(told(folder / name) if (folder / name).exists() else f"| {name} | | | skipped: not there |")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
