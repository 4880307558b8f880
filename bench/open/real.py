"""`python -m bench.open.real FOLDER`: real recordings, unsealed; skipped where they are not. No truth is beside them.

What references can tell: a sphere's stated radius is held against the one that a fit finds when it is left free; a
groove has none. Neither tells a hand-eye pose's or a groove size's error.
"""

from __future__ import annotations

import sys
from pathlib import Path

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
    """What the engine of grooves says of it."""
    told = next(line for line in look(str(path)) if line.startswith("groove: "))
    return f"| {GROOVE} | corners, columns | none | {told.removeprefix('groove: ')} |"


def main(folder: Path) -> int:
    print("| file | quantity | reference | found |\n| --- | --- | --- | --- |")
    for name, told in ((SPHERE, sphere), (GROOVE, groove)):
        print(told(folder / name) if (folder / name).exists() else f"| {name} | | | skipped: not there |")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
