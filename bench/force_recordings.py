"""Recordings of milling force, simulated: `python -m bench.force_recordings [FOLDER]` makes those that are shipped.

A cutter with run-out, a dynamometer that rings, noise: what the identification of coefficients must live with.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy

from workbench.api import Cutter, Float
from workbench.plugins.stiffness.coefficients import PUBLISHED, CuttingCoefficients
from workbench.plugins.stiffness.force_stage import STEPS, Teeth, edges_in_cut

FEEDS = (300.0, 600.0, 900.0)  # mm/min, of the shipped recordings
# The dynamometer: force on the workpiece, x against the feed, y across, z up.
DYNAMOMETER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class Slot(NamedTuple):
    """A cut as the simulator makes it."""

    coefficients: CuttingCoefficients = PUBLISHED["al7075_t6"]
    flutes: int = 2
    diameter_mm: float = 10.0
    axial_mm: float = 3.0
    radial_mm: float = 10.0
    rpm: float = 6000.0
    runout_mm: float = 0.005
    helix: float = np.radians(30.0)
    rate_hz: float = 5000.0
    seconds: float = 0.4
    noise_n: float = 3.0
    ringing_hz: float = 800.0
    axes: Float = DYNAMOMETER


def recording(slot: Slot, feed_mm_min: float, seed: int) -> Float:
    """Samples (n, 4): time in s, then forces in N in the dynamometer's axes."""
    cutter = Cutter(diameter_mm=slot.diameter_mm, flutes=slot.flutes, flute_length_mm=30.0)
    per_tooth = feed_mm_min / (slot.rpm * slot.flutes)
    teeth = Teeth(slot.helix, slot.runout_mm, 0.4)
    one = (np.array([value]) for value in (per_tooth, slot.radial_mm, slot.axial_mm))
    turn = edges_in_cut(cutter, *one, teeth).forces(slot.coefficients)[0, :, :3] @ slot.axes.T
    fine = 4 * slot.rate_hz
    time = np.arange(int(slot.seconds * fine)) / fine
    at = time * slot.rpm / 60.0 * STEPS - 0.5
    force = np.column_stack([np.interp(at, np.arange(STEPS), one, period=STEPS) for one in turn.T])
    w = 2 * np.pi * slot.ringing_hz
    rings = scipy.signal.bilinear([w**2], [1, 2 * 0.05 * w, w**2], fine)
    heard = scipy.signal.lfilter(*rings, force - force.mean(axis=0), axis=0) + force.mean(axis=0)
    noise = np.random.default_rng(seed).normal(0, slot.noise_n, (len(time[::4]), 3))
    return np.column_stack([time[::4], heard[::4] + noise])


def write(path: Path, samples: Float) -> None:
    """A table as `stiffness.identify_forces` reads it."""
    rows = ["time_s,fx_n,fy_n,fz_n", *(f"{t:.4f},{x:.1f},{y:.1f},{z:.1f}" for t, x, y, z in samples)]
    path.write_text("\n".join([*rows, ""]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m bench.force_recordings", description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("data/synthetic/forces"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for k, feed in enumerate(FEEDS):
        write(folder / f"slot_f{feed:.0f}.csv", recording(Slot(), feed, k + 1))
