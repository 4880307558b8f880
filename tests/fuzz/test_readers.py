"""A small share of `make fuzz`: every reader on some mutated files, with a seed of its own."""

import itertools
import random
import sys

import pytest

from bench.fuzz.mutate import mutated
from bench.fuzz.run import fuzz
from bench.fuzz.targets import CORPUS, TARGETS, Target
from workbench.errors import InputError, WorkbenchError

MOST_CALLS = 10_000_000  # of functions, imports among them, until a file is refused: one file made calls without end


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_mutated_files_give_a_result_or_one_line(target):
    outcome = fuzz(target, max(3, round(40 * target.share)), seed=2026)
    assert not outcome.failures
    assert outcome.refused > 0


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_the_good_files_are_good(target, tmp_path):
    """Else nothing but the first check of a reader would be tried."""
    place = target.surroundings(tmp_path)
    for path in target.files():
        copy = place / f"good{path.suffix}"
        copy.write_bytes(path.read_bytes())
        target.read(copy)


def test_what_a_reader_does_wrong_is_found():
    def reads(path):
        if "x" in path.read_text(errors="replace"):
            raise KeyError("x")
        raise InputError(str(path), "expected an x")

    outcome = fuzz(Target("broken", reads, ("CITATION.cff",)), 200, seed=1)
    assert sum(outcome.failures.values()) + outcome.refused == 200
    assert any(what.startswith("KeyError") for what in outcome.failures)


def test_mutations_differ_and_repeat():
    content = b'{"a": [1, 2, {"b": "c"}]}'
    first = [mutated(content, ".json", random.Random(seed)) for seed in range(200)]
    assert first == [mutated(content, ".json", random.Random(seed)) for seed in range(200)]
    assert len(set(first)) > 150


@pytest.mark.parametrize("path", sorted((CORPUS.parent / "refused").iterdir()), ids=lambda path: path.stem)
def test_what_once_made_trouble_is_refused_in_one_line(path, tmp_path):
    target = next(one for one in TARGETS if one.name == path.stem.split("-")[0])
    copy = target.surroundings(tmp_path) / f"mutated{path.suffix}"
    copy.write_bytes(path.read_bytes())
    calls = itertools.count()

    def count(*_: object) -> None:
        assert next(calls) < MOST_CALLS

    sys.setprofile(count)
    try:
        with pytest.raises(WorkbenchError) as told:
            target.read(copy)
    finally:
        sys.setprofile(None)
    assert "\n" not in str(told.value)
    assert "its reader crashed" not in str(told.value)  # as it does at its limit of processor time
