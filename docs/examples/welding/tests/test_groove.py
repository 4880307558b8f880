"""`weld.groove`, `weld.gate` and `weld.report` on inspections whose groove is known."""

import csv
import io

import numpy as np
import pytest
from workbench_welding import gate, groove, report

from workbench.api import InputError, PipelineError

# A plate of 11.5 mm with a root of 1.5 mm and 45 deg: 2 x 11.5 + 10 x 10 = 123 mm2.
PLATE = {"thickness_mm": 11.5, "gap_mm": 2.0, "thickness_u_mm": 0.0, "gap_u_mm": 0.0}


def test_area_volume_and_uncertainty(inspect):
    made = groove(inspect([1.5] * 4, [45.0] * 4), **PLATE, tolerance_percent=(-10, 30))
    u_mm2 = np.hypot(20 * 0.01, 200 * np.radians(0.05))
    assert [s.area_mm2 for s in made.sections] == pytest.approx([123.0] * 4)
    assert [s.area_u_mm2 for s in made.sections] == pytest.approx([u_mm2] * 4)
    assert (made.volume_mm3, made.volume_u_mm3) == pytest.approx((123.0 * 30, u_mm2 * 30))
    assert made.nominal_mm2 == pytest.approx(23 + 100 * np.tan(np.radians(40)))
    assert made.verdict == "pass"


def test_hidden_stretches_have_no_area_and_no_volume(inspect):
    made = groove(inspect([1.5, 1.5, None, 1.5], [40.0, 40.0, None, 40.0]), **PLATE)
    assert made.sections[2].area_mm2 is None
    assert [s.verdict for s in made.sections] == ["pass", "pass", "undecided", "pass"]
    assert made.measured_mm == 10.0
    assert (made.verdict, made.reason) == ("undecided", "weld groove: section 3 undecided")


@pytest.mark.parametrize(
    ("root_mm", "verdict", "rejected_by"),
    [(1.5, "pass", []), (0.5, "fail", ["fail"]), (2.15, "undecided", ["undecided"]), (3.0, "fail", ["fail"])],
)
def test_verdict_with_its_guard_band_and_gate(inspect, root_mm, verdict, rejected_by):
    """Limits +-10 % of 106.91 mm2; at a root of 2.15 mm the area lies 0.26 mm2 within, u being 0.22 mm2."""
    made = groove(inspect([1.5, root_mm], [40.0, 40.0]), **PLATE)
    assert made.verdict == verdict
    assert [r for r in ("fail", "undecided") if not gate(made, reject=[r]).passed] == rejected_by


def test_a_plate_thinner_than_its_root_face_is_refused(inspect):
    with pytest.raises(InputError, match=r"thickness_mm: expected a plate thicker than its root face, 1\.5 mm"):
        groove(inspect([1.5, 1.6], [40.0, 40.0]), thickness_mm=1.2)


def test_a_tolerance_that_excludes_the_nominal_value_is_refused(inspect):
    with pytest.raises(PipelineError, match="lower <= 0 <= upper"):
        groove(inspect([1.5], [40.0]), **PLATE, tolerance_percent=(1, 5))


def test_the_table_and_the_chapter_say_the_groove(inspect):
    made = groove(inspect([1.5, None], [45.0, None]), **PLATE)
    chapter, table = report(made, density_g_cm3=8.0)
    rows = list(csv.DictReader(io.StringIO(table.content.decode())))
    assert float(rows[0]["area_mm2"]) == pytest.approx(123.0)
    assert rows[1] == {
        "section": "2",
        "arc_length_mm": "10.0000",
        "area_mm2": "",
        "area_u_mm2": "",
        "verdict": "undecided",
    }
    assert "123.0 ± " in chapter.html
    assert "0.984" in chapter.html  # 123 mm2 of 8 g/cm3
    assert chapter.verdict == made.verdict
    assert report(made)[0].html == report(made)[0].html
