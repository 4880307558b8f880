"""`Quantity`: laws of propagation, against GTC."""

from __future__ import annotations

import GTC
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from workbench.artefacts import Quantity, Term

U = st.floats(0.0, 10.0)


@given(u=st.lists(U, min_size=1, max_size=5), value=st.floats(-50.0, 50.0))
def test_terms_combine_as_independent_inputs_do(u: list[float], value: float) -> None:
    """A sum of inputs that know nothing of each other, as an independent calculator has it."""
    whole = sum((GTC.ureal(0.0, one) for one in u), start=GTC.ureal(value, 0.0))
    found = Quantity("root_mm", np.array(value), tuple(Term(f"source {k}", "B", one) for k, one in enumerate(u)))
    assert found.u == pytest.approx(GTC.uncertainty(whole), abs=1e-12)


@given(u=st.lists(U, min_size=2, max_size=6), k=st.integers(1, 5))
def test_neither_order_nor_grouping_of_terms_matters(u: list[float], k: int) -> None:
    terms = tuple(Term("one" if i < k else "other", "A", one) for i, one in enumerate(u))
    whole = Quantity("gap_mm", np.zeros(3), terms)
    assert Quantity("gap_mm", np.zeros(3), terms[::-1]).u == pytest.approx(whole.u)
    grouped = Quantity.of("gap_mm", np.zeros(3), whole.u_by_source)
    assert grouped.u == pytest.approx(whole.u)


@given(u=st.lists(U, max_size=4), more=U)
def test_a_further_term_never_lowers_u(u: list[float], more: float) -> None:
    terms = tuple(Term("source", "A", one) for one in u)
    before, after = (Quantity("gap_mm", np.zeros(1), t).u for t in (terms, (*terms, Term("more", "B", more))))
    assert (after >= before).all()


def test_one_value_for_all_stations_and_one_a_station_go_together() -> None:
    found = Quantity("bevel_deg", np.full(3, 40.0), (Term("a", "A", np.array([0.3, 0.4, 0.0])), Term("b", "B", 0.4)))
    assert found.u == pytest.approx([0.5, np.hypot(0.4, 0.4), 0.4])
    assert found.unit == "deg"


def test_at_a_station_it_says_what_the_station_says_and_nothing_where_it_was_not_measured() -> None:
    s = np.array([0.0, 1.0, 2.0])
    found = Quantity("root_mm", np.array([1.5, np.nan, 1.7]), (Term("a", "A", np.array([0.1, 0.2, 0.3])),))
    assert found.at(s, s).u == pytest.approx(found.u)
    assert np.isnan(found.at(0.5, s).value)
    hidden = found.where(np.array([True, True, False]))
    assert np.isnan(hidden.u[2])
    assert hidden.u[:2] == pytest.approx(found.u[:2])
