"""Gauge R&R against AIAG's worked example, against statsmodels-free hand computation, and over simulated studies."""

import math

import numpy as np
import pytest
from scipy.stats import f_oneway

from workbench.compare.gauge import analyse, gauge
from workbench.units import Float

# AIAG, Measurement Systems Analysis, 4th ed. (2010), chapter III B. A row a part; operators A, B, C by threes.
AIAG = np.array(
    [
        [0.29, 0.41, 0.64, 0.08, 0.25, 0.07, 0.04, -0.11, -0.15],
        [-0.56, -0.68, -0.58, -0.47, -1.22, -0.68, -1.38, -1.13, -0.96],
        [1.34, 1.17, 1.27, 1.19, 0.94, 1.34, 0.88, 1.09, 0.67],
        [0.47, 0.50, 0.64, 0.01, 1.03, 0.20, 0.14, 0.20, 0.11],
        [-0.80, -0.92, -0.84, -0.56, -1.20, -1.28, -1.46, -1.07, -1.45],
        [0.02, -0.11, -0.21, -0.20, 0.22, 0.06, -0.29, -0.67, -0.49],
        [0.59, 0.75, 0.66, 0.47, 0.55, 0.83, 0.02, 0.01, 0.21],
        [-0.31, -0.20, -0.17, -0.63, 0.08, -0.34, -0.46, -0.56, -0.49],
        [2.26, 1.99, 2.01, 1.80, 2.12, 2.19, 1.77, 1.45, 1.87],
        [-1.36, -1.25, -1.31, -1.68, -1.62, -1.50, -1.49, -1.77, -2.16],
    ]
).reshape(10, 3, 3, 1)


def test_aiag_table() -> None:
    """The published table of variance: sums of squares, degrees of freedom, F of the interaction."""
    table = analyse(AIAG, 0.05)
    assert [row.freedom for row in table.sources] == [9, 2, 18, 78]
    assert table.part.sum_of_squares == pytest.approx(88.3619, abs=5e-5)
    assert table.operator.sum_of_squares == pytest.approx(3.1673, abs=5e-5)
    assert table.interaction.sum_of_squares == pytest.approx(0.3590, abs=5e-5)
    assert table.repeatability.sum_of_squares == pytest.approx(2.7589 + 0.3590, abs=1e-4)
    assert (table.interaction.f, table.interaction.p) == pytest.approx((0.434, 0.974), abs=5e-4)
    assert table.pooled


def test_aiag_components() -> None:
    """The published EV, AV, GRR, PV, TV, %GRR and ndc; with the interaction kept, EV is another number."""
    found = gauge(analyse(AIAG, 0.05), None)
    published = {"EV": 0.199933, "AV": 0.226838, "GRR": 0.302373, "PV": 1.042327}
    for name, sd in published.items():
        assert found.of(name).sd == pytest.approx(sd, abs=2e-6)
    assert found.of("TV").sd == pytest.approx(1.085, abs=5e-4)
    percent = [found.of(name).contribution_percent for name in ("EV", "AV", "GRR", "PV")]
    assert percent == pytest.approx([3.4, 4.4, 7.8, 92.2], abs=0.05)
    assert found.of("GRR").study_percent == pytest.approx(27.9, abs=0.05)
    assert found.categories == 4
    kept = gauge(analyse(AIAG, 0.999), None)
    assert kept.of("EV").sd == pytest.approx(0.214435, abs=2e-6)


def test_tolerance() -> None:
    """%GRR of a tolerance: six standard deviations over its width."""
    found = gauge(analyse(AIAG, 0.05), 8.0)
    assert found.of("GRR").tolerance_percent == pytest.approx(100 * 6 * 0.302373 / 8.0, abs=1e-3)


def test_one_part_is_an_analysis_by_operator() -> None:
    """Without a second part: the one-way analysis that scipy knows; no part variation, no categories."""
    values = AIAG[:1]
    table = analyse(values, 0.05)
    assert (table.operator.f, table.operator.p) == pytest.approx(tuple(f_oneway(*values[0, ..., 0])))
    found = gauge(table, None)
    within, between = values[0].var(axis=1, ddof=1).mean(), 3 * values[0].mean(axis=1).var(ddof=1)
    assert found.of("EV").sd == pytest.approx(math.sqrt(within))
    assert found.of("AV").sd == pytest.approx(math.sqrt(max(0.0, (between - within) / 3)))
    assert found.of("PV").sd is None
    assert found.categories is None
    assert found.of("GRR").study_percent is None


def test_one_operator_shows_no_reproducibility() -> None:
    values = AIAG[:, :1]
    found = gauge(analyse(values, 0.05), None)
    assert found.of("AV").sd is None
    assert found.of("GRR").sd == found.of("EV").sd == pytest.approx(math.sqrt(values.var(axis=2, ddof=1).mean()))


def test_identical_readings() -> None:
    """A gauge that shows no spread at all: zero, no categories, no division by it."""
    found = gauge(analyse(np.repeat(np.arange(5.0), 6).reshape(5, 2, 3, 1), 0.05), 1.0)
    assert found.of("GRR").sd == 0.0
    assert found.categories is None


def test_a_real_interaction_is_kept() -> None:
    rng = np.random.default_rng(2)
    values = study(rng, (10, 3, 3, 1), {"interaction": 1.0, "error": 0.1})
    assert not analyse(values, 0.05).pooled


def study(rng: np.random.Generator, shape: tuple[int, int, int, int], sd: dict[str, float]) -> Float:
    """A random study of known components; `recording` is an error that all sections of a recording share."""
    p, o, r, s = shape
    shapes = {
        "part": (p, 1, 1, s),
        "operator": (1, o, 1, s),
        "interaction": (p, o, 1, s),
        "error": shape,
        "recording": (p, o, r, 1),
    }
    return np.asarray(sum(sd.get(name, 0.0) * rng.normal(size=shapes[name]) for name in shapes))


@pytest.mark.parametrize(("interaction", "recording", "sections"), [(0.3, 0.0, 1), (0.0, 0.25, 5)])
def test_intervals_cover(interaction: float, recording: float, sections: int) -> None:
    """In 200 studies each interval holds the truth in 95 of 100; in more where sections tell more than counts."""
    sd = {"part": 1.0, "operator": 0.3, "interaction": interaction, "error": 0.2, "recording": recording}
    ev, av = math.hypot(0.2, recording), math.hypot(0.3, interaction)
    truth = {"EV": ev, "AV": av, "GRR": math.hypot(av, ev), "PV": 1.0}
    inside = dict.fromkeys(truth, 0)
    for seed in range(200):
        found = gauge(analyse(study(np.random.default_rng(seed), (8, 6, 3, sections), sd), 0.05), None)
        for name, value in truth.items():
            interval = found.of(name).interval
            inside[name] += interval[0] <= value <= interval[1]
    for name, count in inside.items():
        assert 180 <= count <= (199 if sections == 1 or name == "EV" else 200), (name, inside)
