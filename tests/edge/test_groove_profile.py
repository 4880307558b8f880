"""A profile of a groove, read from both sides, and the types that its sides may make."""

import numpy as np

from workbench.edge.groove_profile import read_profile
from workbench.edge.segment_groove_stage import possible_types, with_a_bevel


def test_types_that_look_alike_from_above_are_all_named() -> None:
    assert possible_types(("bevel", "bevel"), False, False) == ("V", "Y", "X")
    assert possible_types(("bevel", "bevel"), True, False) == ("Y", "X")
    assert possible_types(("square", "round"), False, False) == ("J",)
    assert possible_types(("edge", "round"), False, False) == ("J", "U")
    assert possible_types(("bevel", "round"), False, False) == ()
    assert with_a_bevel(("I", "J")) == ("HV", "HY", "K")
    assert with_a_bevel(("HV", "HY", "K")) == ("V", "Y", "X")
    assert with_a_bevel(("HY", "K")) == ("Y", "X")  # a root face is seen: no V


def test_a_steep_face_of_which_a_few_returns_are_seen_is_not_taken_for_square() -> None:
    x = np.linspace(-14.0, 14.0, 281)
    inwards = 4.0 - np.abs(x)
    y = np.where(inwards < 0.0, 0.0, -inwards * np.tan(np.radians(80.0))) - np.where(x > 0.0, 0.5, 0.0)
    for falls, kinds in ((0.0, ["edge", "edge"]), (0.35, ["unread", "edge"])):  # mm: seen of a bevel of 10 deg
        seen = inwards < np.where(x < 0.0, falls, 0.0)
        sides = read_profile(x[seen], y[seen])
        assert sides is not None
        assert [side.kind for side in sides] == kinds
