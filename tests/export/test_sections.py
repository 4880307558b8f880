"""Exported sections, read back by ezdxf and as rows."""

from __future__ import annotations

import csv
import io
import math

import ezdxf
import numpy as np
import pytest

from workbench.export import sections as export_sections


@pytest.fixture(scope="module")
def drawing(inspected):
    document = export_sections(inspected.inspection, inspected.cloud, inspected.edge)
    assert document.name == "sections.dxf"
    return ezdxf.read(io.StringIO(document.content.decode()))


def test_the_drawing_is_sound_and_in_millimetres(drawing):
    assert drawing.units == ezdxf.units.MM
    drawn = {one.dxf.layer for block in drawing.blocks if block.name.startswith("section_") for one in block}
    coloured = {one.dxf.name for one in drawing.layers if one.dxf.name not in ("0", "Defpoints")}
    assert coloured >= drawn > {"root face", "bevel face"}
    assert not drawing.audit().errors


def test_a_block_a_section_with_lines_of_its_values(drawing, inspected):
    blocks = [insert.dxf.name for insert in drawing.modelspace().query("INSERT")]
    assert blocks == [f"section_{s.index}" for s in inspected.inspection.sections]
    for section in inspected.inspection.sections:
        block = drawing.blocks.get(f"section_{section.index}")
        lines = block.query('LINE[layer=="fit"]')
        if section.values["root_mm"] is None:
            assert not lines
            continue
        root, bevel = lines
        assert math.isclose((root.dxf.end - root.dxf.start).magnitude, section.values["root_mm"], abs_tol=1e-9)
        angle = (root.dxf.end - root.dxf.start).angle_between(bevel.dxf.end - bevel.dxf.start)
        assert math.isclose(math.degrees(angle), section.values["bevel_deg"], abs_tol=1e-6)
        measured = [d.get_measurement() for d in block.query("DIMENSION")]
        assert np.allclose(measured, [section.values["root_mm"], section.values["bevel_deg"]], atol=1e-6)
        assert f"root face {section.values['root_mm']:.3f} mm" in " ".join(t.dxf.text for t in block.query("TEXT"))


def test_points_lie_on_the_lines(drawing, inspected):
    for section in inspected.inspection.sections:
        block = drawing.blocks.get(f"section_{section.index}")
        on_root = np.array([[p.dxf.location.x, p.dxf.location.y] for p in block.query('POINT[layer=="root face"]')])
        on_bevel = np.array([[p.dxf.location.x, p.dxf.location.y] for p in block.query('POINT[layer=="bevel face"]')])
        if section.values["root_mm"] is None or not len(on_root):
            continue
        assert np.abs(on_root[:, 0]).mean() < 0.05
        beta = math.radians(section.values["bevel_deg"])
        off = (on_bevel - [0.0, section.values["root_mm"]]) @ [math.cos(beta), math.sin(beta)]
        assert np.abs(off).mean() < 0.05
        assert on_bevel[:, 1].min() > section.values["root_mm"] - 0.1


def test_rows_say_the_same_in_the_base(inspected):
    document = export_sections(inspected.inspection, inspected.cloud, inspected.edge, format="csv", thickness_mm=0.3)
    rows = list(csv.DictReader(io.StringIO(document.content.decode("ascii"), newline="")))
    assert document.name == "section_points.csv"
    points = [row for row in rows if row["kind"] == "point"]
    assert len(points) > 1000
    sections = {s.index: s for s in inspected.inspection.sections}
    for row in rows[:: max(1, len(rows) // 200)]:
        s = sections[int(row["section"])]
        off = np.array([float(row[k]) for k in ("x_mm", "y_mm", "z_mm")]) - s.origin_mm
        assert abs(off @ s.normal - float(row["normal_mm"])) < 2e-6
        assert abs(off @ s.across - float(row["across_mm"])) < 2e-6
        assert abs(off @ s.tangent) < 0.15 + 1e-6
    measured = [s for s in inspected.inspection.sections if s.values["root_mm"] is not None]
    assert [row["kind"] for row in rows].count("upper_edge") == len(measured)
