"""What equipment does to recordings of `bench.outside`, kind by kind.

What is not refused must be right: these faults move places, sizes and angles by little, and show in the frames.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.outside import Part, Section, Usual, drawn_section, simulate
from bench.recordings import dense_stream, stamped, with_values
from workbench.units import Float

Rng = np.random.Generator
Makes = Callable[[int, bool, Rng], Part]


class Swaying(Usual):
    """A scanner that always sways."""

    def sway_deg(self, rng: Rng) -> float:
        return float(rng.uniform(0.8, 3.0))


class Slow(Swaying):
    """Once to and fro in the scan, or less."""

    def sway_mm(self, rng: Rng) -> Float:
        return rng.uniform(20, 60, 3)


@dataclass(frozen=True, slots=True)
class Chattered(Section):
    """A root face that waves along the edge as chatter leaves it."""

    wave_mm: float = 0.0
    length_mm: float = 2.0

    @property
    def is_even(self) -> bool:
        return False

    def root_at(self, w: Float) -> Float:
        return self.root_mm + self.drift * w + self.wave_mm * np.sin(2.0 * np.pi / self.length_mm * w)


def _with(part: Part, **changes: object) -> Part:
    return part._replace(recording=with_values(part.recording, **changes))


def _moved(part: Part, by_mm: Float) -> Part:
    """Recorded positions beside the true ones by (N, 3) mm in the section's frame: the part, or its poses, moved."""
    dense = dense_stream(part.recording)
    place = dense.robot_position_mm + by_mm @ part.base_from_section[:3, :3].T
    return part._replace(recording=with_values(dense, robot_position_mm=place))


def slipped(seed: int, is_raw: bool, rng: Rng) -> Part:
    """An encoder slips by some tenths of a millimetre within the scan, at once or over some poses."""
    part = simulate(seed, is_raw)
    count = len(part.recording.time_s)
    over = rng.choice([1, 1, rng.integers(2, 12)])
    share = np.clip((np.arange(count) - rng.uniform(0.15, 0.85) * count) / over, 0.0, 1.0)
    axis = rng.normal(size=3)
    return _moved(part, share[:, None] * rng.uniform(0.1, 0.5) * axis / np.linalg.norm(axis))


def _clocked(part: Part, offset_s: Float) -> Part:
    """Frames (N,) stamped so much later than poses that were taken with them."""
    dense = dense_stream(part.recording)
    return part._replace(recording=stamped(dense, dense.time_s + offset_s))


def late(seed: int, is_raw: bool, rng: Rng) -> Part:
    """Poses come late by a constant time, while the scanner sways."""
    part = simulate(seed, is_raw, cell=Swaying())
    return _clocked(part, np.full(len(part.recording.time_s), rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.12)))


def walking(seed: int, is_raw: bool, rng: Rng, cell: type[Usual] = Swaying) -> Part:
    """The clocks walk apart, or frames are lost and not stamped."""
    part = simulate(seed, is_raw, cell=cell())
    share = np.linspace(0.0, 1.0, len(part.recording.time_s))
    shape = [share, np.sin(3.0 * share), np.where(share > rng.uniform(0.2, 0.8), 1.0, 0.0)][rng.integers(3)]
    return _clocked(part, rng.choice([-1.0, 1.0]) * rng.uniform(0.02, 0.2) * shape)


def chattered(seed: int, is_raw: bool, rng: Rng) -> Part:
    """Chatter of the cutter, some millimetres long."""
    of = drawn_section(seed, is_raw, Usual())[1]
    wave = {"wave_mm": rng.uniform(0.03, 0.12), "length_mm": rng.uniform(0.8, 3.0)}
    return simulate(seed, is_raw, Chattered(**dataclasses.asdict(of), **wave))


def vibrating(seed: int, is_raw: bool, rng: Rng) -> Part:
    """The part begins to vibrate towards the end of the scan, in the plate's plane or up and down."""
    part = simulate(seed, is_raw)
    time = part.recording.time_s - part.recording.time_s[0]
    begins = rng.uniform(0.5, 0.9) * time[-1]
    grown = np.clip((time - begins) / (time[-1] - begins), 0.0, 1.0)
    moved = grown * rng.uniform(0.1, 0.5) * np.sin(2.0 * np.pi * rng.uniform(0.5, 40.0) * time)
    return _moved(part, moved[:, None] * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])[rng.integers(2)])


def alternating(seed: int, is_raw: bool, rng: Rng) -> Part:
    """The exposure alternates: every second frame measures further away, and loses columns at the ends of faces."""
    part = simulate(seed, is_raw)
    z = part.recording.z_mm.copy()
    second = np.flatnonzero(np.arange(len(z)) % 2)
    z[second] += rng.choice([0.0, 1.0]) * rng.uniform(0.05, 0.3)
    for _ in range(int(rng.integers(0, 6))):
        lost = ~np.isfinite(z[second])
        lost[:, 1:] |= np.abs(np.diff(z[second], axis=1)) > 1.0
        lost[:, 1:-1] |= ~np.isfinite(z[second][:, :-2]) | ~np.isfinite(z[second][:, 2:])
        z[second] = np.where(lost, np.nan, z[second])
    return _with(part, z_mm=z)


CHATTER = "chatter of 0.8 to 3 mm"
KINDS: dict[str, Makes] = {
    "an encoder slips by 0.1 to 0.5 mm": slipped,
    "poses 10 to 120 ms late, the scanner sways": late,
    "clocks walk apart by 20 to 200 ms, the scanner sways": walking,
    "the same, it sways slowly": lambda *given: walking(*given, Slow),
    "the part begins to vibrate": vibrating,
    "exposure alternates": alternating,
    CHATTER: chattered,
}
