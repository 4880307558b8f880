"""Does a wrong constant fail a test: `python -m bench.mutation.constants workbench/edge/directions.py:SLOPE_MM ...`.

Each named module-level number is scaled, in a copy of the sources, by each factor, and the tests are run on the copy.
A mutant that survives is a constant that no test holds. Compiled code is made anew for each: a minute or two apiece.
"""

from __future__ import annotations

import argparse
import ast
import sys
from pathlib import Path

from bench.mutation.mutant import ROOT, fails

TESTS = ("tests/metrology/test_coverage.py",)


def main(arguments: list[str] | None = None) -> int:
    """Status 1 if a mutant survives."""
    parser = argparse.ArgumentParser(prog="python -m bench.mutation.constants", description=__doc__)
    parser.add_argument("constants", nargs="+", metavar="FILE.py:NAME")
    parser.add_argument("--factors", nargs="+", type=float, default=[0.5, 2.0])
    parser.add_argument("--tests", nargs="+", default=list(TESTS))
    options = parser.parse_args(arguments)
    survived = 0
    print("| constant | factor | |\n| --- | --- | --- |")
    for constant in options.constants:
        path, _, name = constant.partition(":")
        for factor in options.factors:
            source = scaled((ROOT / path).read_text(encoding="utf-8"), name, factor)
            killed = fails(Path(path), source, options.tests)
            survived += not killed
            print(f"| {constant} | {factor:g} | {'killed' if killed else '**survives**'} |", flush=True)
    return int(survived > 0)


def scaled(source: str, name: str, factor: float) -> str:
    """The source with the number that is assigned to `name` at module level multiplied by `factor`.

    An assignment of several names at once (`A, B = 1.0, 2.0`) is understood. ValueError: no such number.
    """
    for node in ast.parse(source).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        pairs = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=True))
        for place, value in pairs:
            if isinstance(place, ast.Name) and place.id == name:
                found = ast.literal_eval(value)
                if isinstance(found, bool) or not isinstance(found, int | float):
                    break
                new = round(found * factor) if isinstance(found, int) and factor >= 1 else found * factor
                lines = source.splitlines(keepends=True)
                row = value.lineno - 1
                assert value.end_col_offset is not None
                line = lines[row].encode()
                lines[row] = (line[: value.col_offset] + repr(new).encode() + line[value.end_col_offset :]).decode()
                return "".join(lines)
    raise ValueError(f"no number {name} at module level")


if __name__ == "__main__":
    sys.exit(main())
