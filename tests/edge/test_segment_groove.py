"""Grooves of the simulators are found, with their type and sizes; what is no groove is refused."""

import numpy as np
import pytest

from bench.groove.__main__ import errors
from workbench.artefacts import Groove
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.edge.groove_profile import read_profile
from workbench.edge.segment_groove import possible_types
from workbench.errors import InputError
from workbench.inspect import groove as inspect_groove
from workbench.scan import fuse
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.synthetic.prism_conditions import random_prism_recipe
from workbench.synthetic.prism_scan import simulate_prism
from workbench.synthetic.swept import GrooveTruth, simulate_groove
from workbench.synthetic.swept.groove_conditions import random_groove_recipe

SEED = 4711


def found(kind: str, seed: int = SEED, **given: object) -> tuple[Groove, GrooveTruth]:
    recording, truth = simulate_groove(random_groove_recipe(kind, seed, clutter=False))
    return segment_groove(denoise(fuse(recording)), **given), truth


@pytest.mark.parametrize("kind", ["I", "V", "HY", "U", "J"])
def test_type_and_sizes_come_back(kind: str) -> None:
    groove, truth = found(kind)
    assert kind in (groove.type, *groove.alternatives)
    rows = errors(inspect_groove(groove), truth)
    assert {"gap_mm", "width_mm", "misalignment_mm"} <= {size for size, _, _ in rows}
    z = np.array([abs(error) / u for _, error, u in rows])
    assert np.median(z) < 1.5  # the values of one part hang together: its share within 2 u tells little
    assert z.max() < 4.0


def test_the_other_simulator_too() -> None:
    recording, truth = simulate_prism(random_prism_recipe("V", SEED))
    inspection = inspect_groove(segment_groove(denoise(fuse(recording))))
    assert "V" in (inspection.type, *inspection.alternatives)
    z = np.array([abs(error) / u for _, error, u in errors(inspection, truth)])
    assert np.mean(z < 2.0) > 0.8


def test_a_wrong_type_is_refused() -> None:
    with pytest.raises(InputError, match=r"groove 'U'.*shows a bevel.*expected V"):
        found("V", groove="U")


def test_a_declared_type_that_is_not_excluded_is_taken() -> None:
    groove, _ = found("V", groove="Y")
    assert groove.type == "Y"
    assert groove.declared
    assert "V" in groove.alternatives or "X" in groove.alternatives


@pytest.mark.parametrize("kind", ["milled", "raw"])
def test_a_plates_edge_is_no_groove(kind: str) -> None:
    recipe = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": 5,
        "part": {"kind": kind, "length_mm": 50.0},
        "passes": [{"from_mm": 5.0, "to_mm": 45.0}],
    }
    recording, _ = simulate_recording(parse_recipe(recipe))
    with pytest.raises(InputError, match="groove"):
        segment_groove(denoise(fuse(recording)))


def test_a_profile_is_read_from_both_sides() -> None:
    x = np.linspace(-10.0, 10.0, 400)
    y = np.where(np.abs(x) > 4.0, 0.0, np.abs(x) * 1.5 - 6.0)
    seen = np.abs(x) > 1.0
    sides = read_profile(x[seen], y[seen])
    assert sides is not None
    assert [side.kind for side in sides] == ["bevel", "bevel"]
    assert [round(float(side.corner[0]), 1) for side in sides] == [-4.0, 4.0]
    assert np.degrees(sides[0].fall) == pytest.approx(np.degrees(np.arctan(1.5)), abs=0.2)


def test_types_that_look_alike_from_above_are_all_named() -> None:
    assert possible_types(("bevel", "bevel"), False, False) == ("V", "Y", "X")
    assert possible_types(("bevel", "bevel"), True, False) == ("Y", "X")
    assert possible_types(("square", "round"), False, False) == ("J",)
    assert possible_types(("edge", "round"), False, False) == ("J", "U")
    assert possible_types(("bevel", "round"), False, False) == ()
    assert possible_types(("edge", "square"), False, False, hides=True) == ("I", "J", "HV", "HY", "K")
    assert possible_types(("edge", "bevel"), True, False, hides=True) == ("HY", "K")
