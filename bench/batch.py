"""Batches of parts through the measured loop, each corrected by itself and by what the parts before it showed.

`python -m bench.batch --help`. One tool error for a batch, a robot whose smooth error nothing repeats; raw part,
first cut and finishing pass, and what scanner and robot do, differ from part to part. Printed: rms of the root face's
error at nine sections (by the exact truth), the correction's share of it (the finishing pass milled once more by a
robot that errs by nothing), and how often 2 sqrt(u^2 + own^2) holds.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from workbench.artefacts import PathCorrection, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment, segment_raw
from workbench.inspect import sections
from workbench.path import correct, feed, layers
from workbench.pipeline.results import correction_document
from workbench.scan import fuse
from workbench.strict_json import strict_json
from workbench.synthetic.workpiece import Workpiece, milled_truth
from workbench.twin import mill, part, scan
from workbench.units import Float

RECIPE = Path(__file__).parents[1] / "data/synthetic/raw_arc.json"
ROOT_MM, ALLOWANCE_MM, SECTIONS = 1.5, 0.5, 9
TOOL_MM = (0.25, -0.15, 0.2)
AGAIN = 500_000  # added to the seed of the finishing pass


class Finished(NamedTuple):
    """Of one part at its sections, mm."""

    error: Float
    corrections: Float  # its share of the error
    u: Float  # of the correction, in root face


def main() -> None:
    """Mill and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--batches", type=int, default=8)
    parser.add_argument("--parts", type=int, default=9, help="of each batch")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--noise", type=float, default=0.03, help="mm, each axis, of what the robot does not repeat")
    told = parser.parse_args()
    found: dict[str, list[list[Finished]]] = {"alone": [], "batch": []}
    for number in range(told.batches):
        with tempfile.TemporaryDirectory() as folder:
            one = milled_batch(Path(folder), told.seed + 1000 * number, told.parts, told.noise)
        for name, parts in one.items():
            found[name].append(parts)
            print(f"batch {number}, {name}: " + ", ".join(f"{_rms(made.error):.3f}" for made in parts), flush=True)
    own_mm = told.noise / math.sin(math.radians(40.0))
    for low, high in ((0, 1), (1, 5), (5, told.parts)):
        for name, batches in found.items():
            if chosen := [one for batch in batches for one in batch[low:high]]:
                print(f"parts {low + 1} to {high}, {name}: {_figures(chosen, own_mm)}")


def milled_batch(folder: Path, seed: int, parts: int, noise_mm: float) -> dict[str, list[Finished]]:
    """One batch, each part finished twice: corrected by itself, and with what is remembered."""
    found: dict[str, list[Finished]] = {"alone": [], "batch": []}
    earlier, recipe = None, json.loads(RECIPE.read_text())
    for k in range(parts):
        (folder / "recipe.json").write_text(json.dumps(recipe | {"seed": seed + k}))
        raw = part(recipe=folder / "recipe.json")
        cloud = denoise(fuse(scan(raw)))
        edge = segment_raw(cloud, upper_side=[0, 0, 1])
        first = feed(layers(edge, cloud, finish_allowance_mm=ALLOWANCE_MM), cloud, edge)
        cut, _ = mill(raw, first, offset_mm=TOOL_MM, robot_noise_mm=noise_mm, seed=seed + k)
        seen = sections(segment(denoise(fuse(scan(cut))), root_nominal_mm=first.root_mm))
        for name, before in (("alone", None), ("batch", earlier)):
            path, correction = correct(seen, first, repeatability_mm=noise_mm, wear_mm=0.0, earlier=before)
            finishing = feed(path, cloud, edge)
            error, share = (_error(cut, finishing, mm, seed + k + AGAIN) for mm in (noise_mm, 0.0))
            missed = ~_at(correction, correction.cut.astype(float)).astype(int).astype(bool)
            error[missed] = share[missed] = np.nan
            u = _at(correction, correction.displacement_u_mm) / math.sin(correction.bevel)
            found[name].append(Finished(error, share, u))
        earlier = folder / "correction.json"
        earlier.write_bytes(strict_json(correction_document(correction)))
    return found


def _error(cut: Workpiece, path: Toolpath, noise_mm: float, seed: int) -> Float:
    """Of the root face at the sections, NaN where it is not cut."""
    done, _ = mill(cut, path, offset_mm=TOOL_MM, robot_noise_mm=noise_mm, seed=seed)
    truth = milled_truth(done)
    s = np.asarray(truth.arc_length_mm)
    return np.asarray(np.interp(s[0] + np.ptp(s) * _shares(), s, truth.root_mm) - ROOT_MM)


def _at(found: PathCorrection, values: Float) -> Float:
    """Values of the correction's stations at the sections."""
    return np.asarray(np.interp(found.length_mm * _shares(), found.arc_length_mm, values))


def _shares() -> Float:
    return (np.arange(SECTIONS) + 0.5) / SECTIONS


def _rms(values: Float) -> float:
    return float(np.sqrt(np.nanmean(values**2)))


def _figures(parts: list[Finished], own_mm: float) -> str:
    error, share, u = (np.concatenate(column) for column in zip(*parts, strict=True))
    known = np.isfinite(error)
    held = np.mean(np.abs(error[known]) <= 2 * np.hypot(u[known], own_mm))
    return f"rms {_rms(error):.4f} mm, by the correction {_rms(share):.4f}, 2 u holds in {100 * held:.1f} %"


if __name__ == "__main__":
    main()
