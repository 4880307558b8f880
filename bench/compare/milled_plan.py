"""The scan of `data/synthetic/paths/raw_arc_milled.h5`: `python -m bench.compare.milled_plan [FILE]`.

The part of `raw_arc.json`, milled in simulation along `paths/raw_arc.json` by a cutter that loses 0.04 mm of its radius
on the way, then scanned: what is left of the bevel lies up to 0.04 mm outside the plan.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

from workbench.path import read
from workbench.scan import write
from workbench.synthetic.workpiece import Workpiece
from workbench.twin import mill, part, scan

DATA = Path("data/synthetic")
WEAR_MM = 0.04


def milled(wear_mm: float = WEAR_MM) -> Workpiece:
    """The part after milling; its scanner's grid coarser than the recipe's, to keep the file small."""
    workpiece = part(recipe=DATA / "raw_arc.json")
    scanner = workpiece.recipe.scanner.model_copy(update={"columns": 300, "pitch_mm": 0.07})
    robot = workpiece.recipe.robot.model_copy(update={"frame_pitch_mm": 0.6})
    workpiece, _ = mill(workpiece, read(toolpath=DATA / "paths" / "raw_arc.json"), wear_mm=wear_mm)
    return dataclasses.replace(
        workpiece, recipe=workpiece.recipe.model_copy(update={"scanner": scanner, "robot": robot})
    )


def main(path: Path) -> None:
    recording = scan(milled())
    write(dataclasses.replace(recording, x_mm=recording.x_mm.round(3), z_mm=recording.z_mm.round(3)), path)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA / "paths" / "raw_arc_milled.h5")
