"""Charts written by hand: what they show, where, and that any text and any value leaves a well-formed file."""

import base64
import io
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from workbench.marks import Lettering, ramp
from workbench.plot import Figure, nice_ticks

SVG = "{http://www.w3.org/2000/svg}"


def test_points_stand_where_the_axes_say():
    figure = Figure(figsize=(10, 5))  # 720 x 360 points
    axes = figure.add_axes((0.1, 0.2, 0.8, 0.6))
    axes.set(xlim=(0.0, 10.0), ylim=(-1.0, 1.0))
    axes.plot([0.0, 5.0, np.nan, 10.0], [-1.0, 0.0, 0.0, 1.0], color="#123456")
    root = ET.fromstring(figure.svg())
    (line,) = [path for path in root.iter(f"{SVG}path") if path.get("stroke") == "#123456"]
    assert line.get("d") == "M72 288L360 180M648 72"  # broken where a value is missing


@pytest.mark.parametrize(
    ("limits", "most", "names"),
    [
        ((0.0, 77.0), 5, ["0", "20", "40", "60"]),
        ((0.95, 2.05), 6, ["1.0", "1.2", "1.4", "1.6", "1.8", "2.0"]),
        ((-0.011, 0.012), 5, ["−0.010", "−0.005", "0.000", "0.005", "0.010"]),
        ((39.9, 40.1), 2, ["39.9", "40.0", "40.1"]),
        ((1e6, 2e6), 2, ["1000000", "1500000", "2000000"]),
    ],
)
def test_ticks_are_round_and_within(limits, most, names):
    assert nice_ticks(limits, most)[1] == names


@given(st.floats(-1e9, 1e9), st.floats(1e-6, 1e9), st.integers(2, 12))
@settings(deadline=None)
def test_ticks_of_any_limits(low, span, most):
    if low + span * 1e-3 == low:
        return
    at, names = nice_ticks((low, low + span), most)
    assert len(at) == len(names) == len(set(names))
    assert 1 <= len(at) <= most + 1
    assert all(low - 1e-6 * span <= one <= low + span * (1 + 1e-6) for one in at)


@given(st.text(), st.lists(st.floats(), min_size=1, max_size=20))
@settings(deadline=None, max_examples=60)
def test_any_text_and_value_leaves_a_well_formed_file(text, values):
    text = "".join(c for c in text if c.isprintable() or c == "\n")
    figure = Figure(figsize=(3, 2))
    axes = figure.add_axes((0.2, 0.2, 0.7, 0.7))
    axes.set(xlim=(-1.0, 30.0), ylim=(-5.0, 5.0))
    places = np.arange(len(values))
    axes.plot(places, values)
    axes.points(places, values, ".")
    axes.fill_between(places, values, np.add(values, 1.0), color="#000000")
    axes.annotate(text, (0.5, 0.5), look=Lettering(rotation=90, box=True))
    axes.set(xlabel=text)
    assert ET.fromstring(figure.svg()).tag == f"{SVG}svg"


@pytest.mark.parametrize("columns", [1, 2])
def test_cells_are_coloured_by_their_value_the_first_row_lowest(columns):
    figure = Figure(figsize=(10, 5))
    axes = figure.add_axes((0.1, 0.1, 0.7, 0.8))
    values, behind = np.array([[0.0, 0.5], [np.nan, 1.0]])[:, :columns], [["#ffffff"] * columns, ["#ff0000"] * columns]
    axes.heat(values, 10.0 * np.arange(1, columns + 1), np.array([0.0, 4.0]), behind)
    image = next(ET.fromstring(figure.svg()).iter(f"{SVG}image"))
    pixels = np.array(Image.open(io.BytesIO(base64.b64decode(image.get("href").split(",")[1]))))
    assert pixels[0, 0].tolist() == [255, 0, 0, 140]
    assert pixels[1, 0].tolist() == [*ramp(np.zeros(1))[0], 255]
    assert axes.get_ylim() == (-2.0, 6.0)
    assert axes.get_xlim() == ((5.0, 25.0) if columns > 1 else (9.5, 10.5))
