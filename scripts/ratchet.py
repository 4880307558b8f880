"""The size of the house: what may fall and never rises, but by an entry with its reason in `scripts/ratchet.txt`.

A line there is `ROOM MEASURE LIMIT`; a line `ROOM MEASURE +N: why` lifts the limit for what is new. git keeps both
sides' lines of that file (`.gitattributes`), so that no merge of it conflicts: of two limits of one room the smaller
one holds, what lifts it adds up.

What is measured cannot be had by longer lines, fewer files or arguments packed together:

- `nodes`: nodes of the syntax tree, a docstring being one
- `numbers`: numbers in statements of modules and classes
- `literals`: numbers within functions, other than whole ones below ten, a half, and powers of ten
- `complex`: functions above 12 paths; operands of `and` and `or`, comprehensions and conditional expressions count
- `inner_tests`: test functions in files that import what no user sees: a module within a room, a `_name`
- of `plain-verdict` (of a milled edge) and `plain-program`, what one process loads for it:
  `nodes`, which what is granted to a room's nodes lifts too; `modules` is a finding only where `nodes` rose, so that
  a file may be split
"""

import ast
import json
import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "scripts/ratchet.txt"
MOST_COMPLEX = 12
PLAIN = {0.5, *range(10), *(10**k for k in range(1, 10)), *(10.0**-k for k in range(1, 16))}
PATHS = (
    ast.If,
    ast.For,
    ast.AsyncFor,
    ast.While,
    ast.ExceptHandler,
    ast.IfExp,
    ast.Assert,
    ast.comprehension,
    ast.match_case,
)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
PACKAGES = ("plugins/calibration", "plugins/stiffness")  # rooms of their own below a folder
RUNS = {
    "plain-verdict": ["inspect_bevel.json"],
    "plain-program": [
        *(
            "plan_bevel.json",
            "--input",
            f"cell={ROOT / 'data/robot/cell.json'}",
            "--input",
            "depth_of_cut_mm=4.5",  # one layer loads what five load
        ),
        *("--set", "stiffness.posture.cutter_rotation_deg=[0, 0]", "--set", "stiffness.posture.turntable_deg=[0, 0]"),
    ],
}
Sizes = dict[str, dict[str, int]]


def room_of(path: Path) -> str:
    """The room that a file of the package, of its tests, or of what stands beside it belongs to."""
    parts = path.relative_to(ROOT).parts
    if parts[0] not in ("workbench", "tests"):
        return parts[0]
    for package in PACKAGES:
        if "/".join(parts[1:3]) == package:
            return package
    return parts[1] if len(parts) > 2 else "workbench"


def within(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes of a tree; the standard library's `walk` takes three times as long."""
    ahead = [tree]
    while ahead:
        one = ahead.pop()
        yield one
        for value in vars(one).values():
            if isinstance(value, ast.AST):
                ahead.append(value)
            elif isinstance(value, list):
                ahead += [each for each in value if isinstance(each, ast.AST)]


def numbers_in(tree: ast.AST) -> list[float]:
    """Numbers of a tree; True and False are none."""
    values = [one.value for one in within(tree) if isinstance(one, ast.Constant)]
    return [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]


def complexity(function: ast.AST) -> int:
    """Paths through a function, functions within it aside."""
    count, ahead = 1, list(ast.iter_child_nodes(function))
    while ahead:
        one = ahead.pop()
        if isinstance(one, FUNCTIONS):
            continue
        ahead += ast.iter_child_nodes(one)
        count += isinstance(one, PATHS)
        count += len(one.values) - 1 if isinstance(one, ast.BoolOp) else 0
        count += len(one.ifs) if isinstance(one, ast.comprehension) else 0
    return count


def nodes_in(every: list[ast.AST]) -> int:
    """Nodes of a file, a docstring being one."""
    return len(every) - sum(isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant) for one in every)


def size_of(text: str) -> Counter[str]:
    """What one file of the package weighs."""
    every = list(within(ast.parse(text)))
    functions = [one for one in every if isinstance(one, FUNCTIONS)]
    inside = [part for one in functions for part in one.body if not isinstance(part, FUNCTIONS)]
    outside = [part for one in every if isinstance(one, ast.Module | ast.ClassDef) for part in one.body]
    stated = [part for part in outside if not isinstance(part, (*FUNCTIONS, ast.ClassDef))]
    return Counter(
        nodes=nodes_in(every),
        numbers=sum(len(numbers_in(part)) for part in stated),
        literals=sum(number not in PLAIN for part in inside for number in numbers_in(part)),
        complex=sum(complexity(one) > MOST_COMPLEX for one in functions),
    )


def is_inner(name: str) -> bool:
    """Whether an imported name is none that users are told of: a module within a room, or one with an underscore."""
    parts = name.split(".")
    if parts[0] != "workbench":
        return False
    if any(part.startswith("_") and not part.endswith("__") for part in parts):
        return True
    folder = ROOT.joinpath(*parts[: 3 if parts[1:2] == ["plugins"] else 2])
    room = len(folder.relative_to(ROOT).parts)
    return folder.is_dir() and len(parts) > room and folder.joinpath(parts[room] + ".py").is_file()


def inner_tests(text: str) -> int:
    """How many test functions a file has, if it imports what users are not told of."""
    tree = ast.parse(text)
    imported = []
    for one in within(tree):
        if isinstance(one, ast.Import):
            imported += [each.name for each in one.names]
        elif isinstance(one, ast.ImportFrom) and one.module:
            imported += [f"{one.module}.{each.name}" for each in one.names]
    if not any(map(is_inner, imported)):
        return 0
    return sum(isinstance(one, FUNCTIONS) and one.name.startswith("test") for one in within(tree))


def loaded() -> Sizes:
    """What a plain verdict and a plain program load, each run in a process of its own."""
    children = {
        name: subprocess.Popen(
            [sys.executable, "-c", CHILD, *run],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name, run in RUNS.items()
    }
    sizes = {}
    for name, child in children.items():
        told, wrong = child.communicate()
        if not told:
            raise SystemExit(f"ratchet: the {name} did not run: {wrong.strip()[-400:]}")
        files = [Path(each) for each in json.loads(told.splitlines()[-1])]
        nodes = sum(nodes_in([*within(ast.parse(each.read_text()))]) for each in files)
        sizes[name] = {"nodes": nodes, "modules": len(files)}
    return sizes


CHILD = """
import json, sys, tempfile
from workbench import cli
with tempfile.TemporaryDirectory() as folder:
    try:
        cli.main(["run", "pipelines/" + sys.argv[1], *sys.argv[2:], "--out", folder + "/out"])
    except SystemExit:
        pass
print()
print(json.dumps([one.__file__ for name, one in sorted(sys.modules.items()) if name.split(".")[0] == "workbench"]))
"""


def measured(with_loaded: bool) -> Sizes:
    """Every room's figures now; what a verdict and a program load takes a minute."""
    sizes: dict[str, Counter[str]] = {}
    for folder in ("workbench", "bench", "scripts"):
        for path in (ROOT / folder).rglob("*.py"):
            here = size_of(path.read_text())
            sizes.setdefault(room_of(path), Counter()).update(
                here if folder == "workbench" else {"nodes": here["nodes"]}
            )
    assert not sizes.keys() & RUNS.keys(), "a room and a run of one name"
    for path in (ROOT / "tests").rglob("*.py"):
        sizes.setdefault(room_of(path), Counter()).update(inner_tests=inner_tests(path.read_text()))
    return {**{room: dict(here) for room, here in sizes.items()}, **(loaded() if with_loaded else {})}


def record() -> tuple[Sizes, list[str]]:
    """The limits that the record sets, and its lines that lift one."""
    limits: Sizes = {}
    lifts = []
    for line in RECORD.read_text().splitlines() if RECORD.is_file() else ():
        if lift := re.fullmatch(r"(\S+) (\S+) \+(\d+): \S.*", line):
            lifts.append((lift[1], lift[2], int(lift[3]), line))
        elif stated := re.fullmatch(r"(\S+) (\S+) (\d+)", line):
            here = limits.setdefault(stated[1], {})
            here[stated[2]] = min(int(stated[3]), here.get(stated[2], int(stated[3])))
        elif line and not line.startswith("#"):
            raise SystemExit(f"{RECORD.name}: expected ROOM MEASURE LIMIT or ROOM MEASURE +N: why, got {line!r}")
    for room, measure, more, _ in lifts:
        here = limits.setdefault(room, {})
        here[measure] = here.get(measure, 0) + more
        for run in RUNS:
            if in_package(room, measure) and run in limits:
                limits[run]["nodes"] += more
    return limits, [line for *_, line in lifts]


def in_package(room: str, measure: str) -> bool:
    """Whether a lift is of what a verdict or a program may load."""
    return measure == "nodes" and room not in ("bench", "scripts", *RUNS)


def rises(now: Sizes, limits: Sizes) -> list[tuple[str, str, int, int]]:
    """Room, measure, figure and limit wherever the figure is above its limit."""
    risen = []
    for room, here in now.items():
        for measure, value in here.items():
            limit = limits.get(room, {}).get(measure, 0)
            split = measure == "modules" and here["nodes"] <= limits.get(room, {}).get("nodes", 0)
            if value > limit and not split:
                risen.append((room, measure, value, limit))
    return risen


def findings(now: Sizes) -> list[str]:
    """One line for each figure that rose."""
    return [
        f"{room}: {measure} {value}, at most {limit} (scripts/ratchet.txt); take something away, or state why it is "
        "worth it: scripts/check_repository.py --because 'WHY'"
        for room, measure, value, limit in rises(now, record()[0])
    ]


def lift_of(line: str) -> tuple[str, str, int]:
    """Room, measure and size of a line that lifts a limit."""
    room, measure, more, *_ = line.split()
    return room, measure, int(more.rstrip(":"))


def remaining(lifts: list[str], now: Sizes) -> list[str]:
    """What still lifts a limit: what was granted last and is more than there is now was given back."""
    left = {(room, measure): value for room, here in now.items() for measure, value in here.items()}
    kept = []
    for line in lifts:
        room, measure, more = lift_of(line)
        granted = min(more, left.get((room, measure), 0))
        left[room, measure] = left.get((room, measure), 0) - granted
        if granted:
            kept.append(f"{room} {measure} +{granted}:{line.partition(':')[2]}")
    return kept


def write(now: Sizes, why: str = "") -> None:
    """Write down what fell, and with a reason `why` what rose."""
    limits, lifts = record()
    kept_runs = {run: dict(limits[run]) for run in RUNS if run in limits and run not in now}
    now = {room: dict(here) for room, here in now.items()} | kept_runs
    for room, measure, value, limit in rises(now, limits) if RECORD.is_file() else ():
        if why:
            lifts.append(f"{room} {measure} +{value - limit}: {why}")
            for run in kept_runs if in_package(room, measure) else ():
                now[run]["nodes"] += value - limit
        else:
            now[room][measure] = limit
    kept, lifted = remaining(lifts, now), Counter[tuple[str, str]]()
    for room, measure, more in map(lift_of, kept):
        for each in (room, *RUNS) if in_package(room, measure) else (room,):
            lifted[each, measure] += more
    lines = [
        "# ROOM MEASURE LIMIT, or ROOM MEASURE +N: why. By scripts/check_repository.py --write (CONTRIBUTING.md, Size)"
    ]
    for room in sorted(now):
        lines += [
            f"{room} {measure} {value - lifted[room, measure]}" for measure, value in sorted(now[room].items()) if value
        ]
    RECORD.write_text("\n".join([*lines, "", *kept]).rstrip() + "\n")
