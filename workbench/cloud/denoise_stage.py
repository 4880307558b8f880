"""`cloud.denoise`: reject the returns that no surface explains."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud
from workbench.geometry.chains import noise_sigma
from workbench.geometry.outliers import reject_outliers
from workbench.stage import stage

SAMPLE_FRAMES = 60  # frames that the noise is judged from
NOISE_SIGMAS = 9.0  # of a second difference, whose sigma is 2.4 times the noise


@stage("cloud.denoise")
def denoise(
    cloud: Cloud,
    *,
    window_frames: Annotated[int, Field(ge=3, le=31)] = 5,
    tolerance_mm: Annotated[
        float | None,
        Field(gt=0, le=5),
    ] = None,
    jump_mm: Annotated[float, Field(gt=0, le=20)] = 1.0,
) -> Cloud:
    """Reject isolated returns and short streaks, on the scanner's own grid.

    A return is kept if it continues the line of two neighbours in its profile, lies between two of them, or agrees with
    the same column of the next frames. Points are marked, not removed.

    Args:
        cloud: the organised cloud.
        window_frames: number of frames compared with each other (odd).
        tolerance_mm: greatest distance of a return from its neighbours' line; null: from the range noise.
        jump_mm: range step between columns that ends a surface.

    Example:
        >>> from workbench import cloud, scan
        >>> made = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> sorted(made.rejected)
        ['isolated returns', 'short streaks']
    """
    tolerance = tolerance_mm if tolerance_mm is not None else max(0.06, NOISE_SIGMAS * range_noise(cloud))
    keep, isolated, streaks = reject_outliers(
        cloud.z_mm, cloud.keep, cloud.pass_index, tolerance, window_frames, jump_mm
    )
    rejected = {**cloud.rejected, "isolated returns": isolated, "short streaks": streaks}
    return replace(cloud, keep=keep, rejected=rejected)


def range_noise(cloud: Cloud) -> float:
    """Standard deviation of the range noise (mm): the median over some frames of `noise_sigma`."""
    frames = np.unique(np.linspace(0, len(cloud.keep) - 1, SAMPLE_FRAMES).astype(int))
    values = [noise_sigma(cloud.z_mm[i][cloud.keep[i]].astype(np.float64)) for i in frames if cloud.keep[i].sum() > 12]
    return float(np.median(values)) if values else 0.0
