"""Small files in the forms of several makers, with made-up numbers: a plate with a step, scanned over a few rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from workbench.units import Float

FRAMES, COLUMNS, PITCH_MM, STEP_MM = 6, 40, 0.25, 0.5
X_MM = np.round(np.arange(COLUMNS) * PITCH_MM - 5.0, 3)
TRAVEL_MM = np.round(np.arange(FRAMES) * STEP_MM, 3)


def heights_mm() -> Float:
    """Heights (FRAMES, COLUMNS) with holes: at both ends and in the middle of some rows."""
    z = 80.0 + np.where(X_MM > 0, 3.0, 0.0) + 0.1 * TRAVEL_MM[:, None] + 0.01 * X_MM
    z[1, 10:13] = z[2, :2] = z[4, -3:] = np.nan
    return np.asarray(np.round(z, 3))


def write_scancontrol(path: Path) -> Path:
    """Blocks of x, y and z rows: points without return are left out."""
    z = heights_mm()

    def block(grid: Float) -> str:
        rows = (";".join(f"{v:.3f}".replace(".", ",") for v in row[~np.isnan(z[i])]) for i, row in enumerate(grid))
        return "".join(f"{row};\r\n" for row in rows)

    x, y = np.broadcast_to(X_MM, z.shape), np.broadcast_to(TRAVEL_MM[:, None], z.shape)
    path.write_bytes("\r\n".join([block(x), block(y), block(z)]).encode())
    return path


def write_gocator(path: Path, surfaces: int = 1) -> Path:
    """Blocks closed by End; a surface of heights by y and x, an empty cell for no return."""
    lines = ["Info", "CSV Version,Sensor Count,Trigger Mode", "2,1,0", "End", ""]
    lines += ["DeviceInfo", "ID,Model,Version", "123,31MADEUP-01,5.1", "End", ""]
    for number in range(1, surfaces + 1):
        lines += [
            "Part",
            "Frame,Source,Time,Encoder,Row Count,Column Count,X Offset",
            f"{number},0,12,0,{FRAMES},{COLUMNS},-5",
        ]
        lines.append(",".join(["Y\\X", *(f"{x:.5f}" for x in X_MM)]))
        for y, row in zip(TRAVEL_MM, heights_mm(), strict=True):
            lines.append(",".join([f"{y:.5f}", *("" if np.isnan(z) else f"{z:.5f}" for z in row)]))
        lines += ["End", ""]
    path.write_text("\n".join(lines))
    return path


def write_gopxl(path: Path, row: int = 1) -> Path:
    """One profile: every point has its index, those without return are not valid."""
    lines = ["Index,X_mm,Z_mm,Intensity,Valid"]
    for i, (x, z) in enumerate(zip(X_MM, heights_mm()[row], strict=True)):
        lines.append(f"{i},{x:g},{0 if np.isnan(z) else z:g},{100 + i},{int(not np.isnan(z))}")
    path.write_text("\n".join(lines) + "\n")
    return path
