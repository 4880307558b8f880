"""What the tables of the studies leave out can still be read off them."""

import csv
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

from bench.confidently_wrong.__main__ import every_kind, table
from bench.metrology.figures import told
from bench.metrology.folding import fold
from bench.metrology.table import markdown, not_met, put_into


def test_what_is_alike_in_all_rows_is_said_once() -> None:
    head = ["condition", "parts", "within 2u, %", "95 % interval", "refused"]
    rows = [[name, "5", share, interval, ""] for name, share, interval in SHARES]
    table, said = markdown(head, rows)[:-2], markdown(head, rows)[-1]
    assert table[0] == "| condition | within 2u, % (95 % interval) |"
    assert table[2:] == [
        "| a | 95.0 (93.0 to 97.0) |",
        "| b | 100.0 |",
        "| c | **80.0** (70.0 to 90.0) |",
        "| d | 96.0 |",
    ]
    assert said == "In all rows: parts 5."
    assert markdown(head, rows[:3])[0].count("|") == 5  # three rows may be alike by chance


def test_what_few_rows_differ_in_is_said_with_their_names() -> None:
    rows = [[name, "0", "1.5"] for name in "abcdef"]
    rows[2][1] = "3"
    assert markdown(["condition", "refused", "goal"], rows)[-1] == "In all rows: refused 0 (but c 3); goal 1.5."
    twice = [[name, mechanics, "0", "x"] for name in "abc" for mechanics in ("perfect", "errors")]
    twice[3][2] = ""
    assert markdown(["condition", "mechanics", "refused", ""], twice)[0] == "| condition | mechanics |"
    assert "refused 0 (but b errors none)" in markdown(["condition", "mechanics", "refused", ""], twice)[-1]


SHARES = [
    ("a", "95.0", "93.0 to 97.0"),
    ("b", "100.0", "100.0 to 100.0"),
    ("c", "**80.0**", "70.0 to 90.0"),
    ("d", "96.0", "96.0 to 96.0"),
]


def test_goals_that_most_miss_name_those_that_do_not() -> None:
    short = ["a: u", "b: u", "c: u", "a: time", "a: all", "b: all", "c: all", "d: all"]
    assert not_met(short, "abcd") == "Not met: u (all but d); time (a); all (all)."
    assert not_met([]) == "Not met: nothing."


def test_causes_that_differ_by_their_numbers_are_one() -> None:
    part = lambda seed: SimpleNamespace(seed=seed, seen_share=0.5)  # noqa: E731
    lines = told([("a", "refused", "off by 1.2 mm", part(1)), ("a", "refused", "off by 3 mm", part(2))])
    lines += told([("b", "crashed", None, part(3))])
    assert lines[0] == "- a, seed 1 (so too 2): refused: off by 1.2 mm (50 % of the edge in view)"
    assert lines[2].startswith("- b, seed 3: crashed")


def test_large_tables_have_their_extremes_in_the_page_and_all_rows_beside_it(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("<!-- tables: begin -->\n<!-- tables: end -->")
    rows = [[f"c{k}", f"{0.1 * k:.1f}, {(3 - k) ** 2:.1f}", f"**{90 + k}** (80 to 100)"] for k in range(11)]
    table = "\n".join(markdown(["condition", "median, worst", "covers"], rows))
    words = "\n".join(markdown(["condition", "advice"], [[f"c{k}", f"turn {k}"] for k in range(16)]))
    put_into(page, f"### One\n{table}\n\n### The other, again\n{table}\n\n### Words\n{words}")
    text = page.read_text()
    assert text.count(table) == 1  # the first may be larger
    assert words in text
    assert "| median, worst | 0.3, 0.0 (c3) | 1.0, 49.0 (c10) |\n| covers | **90** (c0) |" in text
    assert "[All rows](tables/page_the_other.csv)." in text
    with open(tmp_path / "tables" / "page_the_other.csv", newline="") as file:
        assert list(csv.reader(file))[1:] == [[cell.replace("**", "") for cell in row] for row in rows]


def test_a_large_first_table_is_folded_too_without_its_columns_of_words(tmp_path: Path) -> None:
    rows = [[f"c{k}", f"{k}, 0", "yes" if k % 2 else "**no**"] for k in range(22)]
    text = fold(tmp_path / "page.md", "\n".join(["### One", *markdown(["condition", "error, wrong", "met"], rows)]))
    assert (
        "| error, wrong | 0, 0 (c0) | 21, 0 (c21) |" in text
    )  # where the last number is alike, the one before decides
    assert "met |" not in text


def test_of_folded_tables_columns_of_several_values_come_apart_and_all_has_a_column(tmp_path: Path) -> None:
    head = ["condition", "root, mm: p95; mean u", "s"]
    rows = [[f"c{k}", f"{k / 10:.1f}; {(32 - k) / 100:.2f}", "0.1"] for k in range(32)] + [["all", "0.4; 0.05", "0.1"]]
    text = fold(tmp_path / "page.md", "\n".join(["### Milled", *markdown(head, rows)]))
    assert "| | smallest | largest | all |" in text
    assert "| root, mm: p95 | 0.0 (c0) | 3.1 (c31) | 0.4 |" in text
    assert "| root, mm: mean u | 0.01 (c31) | 0.32 (c0) | 0.05 |" in text
    assert (tmp_path / "tables" / "page_milled.csv").read_text().splitlines()[-1] == "all,0.4,0.05"


def test_outcomes_of_corruptions_are_counted_and_those_to_look_at_have_their_kinds() -> None:
    inspections = {f"k{k}": Counter({"right": 2, "honest": k}) for k in range(7)} | {"nothing": Counter(honest=9)}
    lines = table(inspections, {name: Counter() for name in inspections})
    assert "| right | 14 | 0 |" in lines
    assert "| honest | 21: k6 (6), k5 (5), k4 (4), k3 (3), k2 (2), ... | 0 |" in lines
    assert every_kind(inspections, inspections)[-2] == ["k6", "2 right, 6 honest", "2 right, 6 honest"]
