"""Control charts: constants of the tables, and each rule on a series made for it alone."""

import numpy as np
import pytest

from workbench.batch.control import individuals, rules

QUIET = [0.2, -0.3, 0.1, 0.4, -0.2, -0.5, 0.3, 0.6, -0.1, -0.4]
SERIES = {  # rule: values in sigma, and where it signals
    1: ([*QUIET, 3.1, -0.2], [10]),
    2: ([-0.4, *[0.3, 1.2, 0.1, 0.5, 0.9, 1.1, 0.2, 0.8, 0.4], -0.3], [9]),
    3: ([0.2, -1.4, -0.9, -0.5, 0.1, 0.6, 1.3, 0.4], [6]),
    4: ([1.3, -0.5, *[0.5, -0.5] * 6, -0.6], [13]),
    5: ([*QUIET, 2.3, 0.2, 2.1, -0.4], [12]),
    6: ([*QUIET, 1.2, 1.3, 0.2, 1.1, 1.4, -0.4], [14]),
    7: ([1.4, *[0.3, -0.2, -0.5, 0.4, 0.7, -0.3, -0.1, 0.6, 0.2, -0.8, 0.1, 0.5, -0.4, -0.6, 0.3], 1.5], [15]),
    8: ([*QUIET, 1.3, -1.2, -1.5, 1.1, 1.2, -1.3, 1.4, -1.1, 0.2], [17]),
}


@pytest.mark.parametrize("rule", SERIES)
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_each_rule_signals_where_it_is_meant_to(rule: int, turned: float) -> None:
    values, where = SERIES[rule]
    found = {name: np.flatnonzero(flags).tolist() for name, flags in rules(turned * np.array(values), 0.0, 1.0).items()}
    assert found.pop(rule) == where
    assert not any(found.values())


def test_the_chart_by_hand() -> None:
    chart = individuals(np.array([10.0, 12.0, np.nan, 11.0, 15.0]))
    assert chart.order.tolist() == [0, 1, 3, 4]
    assert (chart.centre, chart.moving_range.tolist()) == (12.0, [2.0, 1.0, 4.0])
    assert chart.sigma == pytest.approx((7 / 3) / 1.128379, rel=1e-6)
    assert chart.limits == pytest.approx((12 - 3 * chart.sigma, 12 + 3 * chart.sigma))
    assert chart.range_limit == pytest.approx(3.2665 * 7 / 3, rel=1e-4)


def test_a_quiet_process_signals_as_seldom_as_chance() -> None:
    rng = np.random.default_rng(4)
    count = sum(rule == 1 for _ in range(300) for _, rule in individuals(rng.normal(size=100)).signals)
    assert 40 < count < 130  # 0.27 % of 30,000 are 81


@pytest.mark.parametrize("values", [[], [1.0], [np.nan, np.nan], [2.0, 2.0, 2.0] * 6])
def test_too_little_to_say_anything(values: list[float]) -> None:
    assert individuals(np.array(values)).signals == ()
