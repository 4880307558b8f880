"""What a person sees of a run: stages as they go by, why the first run takes longer, results as tables."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from workbench.artefacts import Characteristic, Gate, JointInspection, Moves, Rework, Toolpath
from workbench.errors import one_line
from workbench.kernels import compiling
from workbench.pipeline.catalogue import makes, parameter_texts, prose, source_text
from workbench.stage import Stage
from workbench.user_folder import folder

if TYPE_CHECKING:
    from rich.table import Table

    from workbench.pipeline.run import Results


SELDOM_S = 15.0  # between two words on how far a stage is, in a stream that keeps them all


class Reporter:
    """Told what a run is doing; this one keeps it to itself."""

    def begin(self, index: int, count: int, name: str) -> None:
        """Stage `name`, number `index` from 0, begins."""

    def fraction(self, done: float) -> None:
        """The stage has done this share of its work, 0 to 1."""

    def end(self, seconds: float) -> None:
        """The stage has ended."""

    def note(self, text: str) -> None:
        """What a later stage says already now; '': nothing."""

    def known(self, results: Any) -> None:
        """All is measured and decided (`pipeline.run.Results`); what follows are pages."""

    def compiling(self) -> None:
        """Kernels are being compiled, once after installing."""


class Lines(Reporter):
    """One line a stage on a stream; on a terminal it is rewritten in place while the stage runs."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self.live = stream.isatty()
        self.label = ""  # of the stage that is running
        self.told_s = 0.0  # when something was last shown of it

    def begin(self, index: int, count: int, name: str) -> None:
        """Show which stage is running."""
        self.label = f"[{index + 1}/{count}] {name}"
        self._show(self.label)

    def fraction(self, done: float) -> None:
        """Show how far it is: anew where a line can be rewritten, else now and then behind it."""
        percent = f"{100 * min(max(done, 0.0), 1.0):3.0f} %"
        if self.live:
            self._show(f"\r{self.label} {percent}")
        elif time.monotonic() - self.told_s > SELDOM_S:
            self._show(f" {percent.strip()}")

    def end(self, seconds: float) -> None:
        """Show how long it took."""
        self._show(f"\r{self.label} {seconds:.2f} s\n" if self.live else f" {seconds:.2f} s\n")
        self.label = ""

    def note(self, text: str) -> None:
        """Show it in a line of its own."""
        self._show(f"{one_line(text)}\n" if text else "")

    def compiling(self) -> None:
        """Say why it takes so long this time."""
        kept = one_line(folder().note()) or "only once after installing"
        self._show(f"\ncompiling kernels for this machine: {kept}\n{self.label}")

    def close(self) -> None:
        """End the line of a stage that failed or was stopped."""
        if self.label:
            self._show("\n")

    def _show(self, text: str) -> None:
        with suppress(OSError):  # a run does not fail because nobody can watch it
            self.told_s = time.monotonic()
            self.stream.write(text)
            self.stream.flush()


@contextmanager
def compilation_watch(reporter: Reporter) -> Iterator[None]:
    """Tell the reporter, once, when a kernel has to be compiled."""
    pending = [reporter.compiling]
    with compiling(lambda: pending.pop()() if pending else None):
        yield


COLOURS = {"pass": "green", "fail": "red", "undecided": "yellow"}


def print_findings(results: Results) -> None:
    """The last inspection as a table, those before it in a line with their stage's name; the gates' decisions."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    listed: list[Gate] = []
    gates = len({id(artefact) for artefact in results if isinstance(artefact, Gate)})
    every = [(stage, one) for stage, made in results.artefacts.items() for one in made]
    last = next((one for _, one in reversed(every) if isinstance(one, JointInspection)), None)
    for stage, artefact in every:
        if isinstance(artefact, JointInspection) and artefact is not last:
            console.print(Text(one_line(f"{stage}: {inspection_summary(artefact)}")), soft_wrap=True)
        elif isinstance(artefact, JointInspection):
            console.print(_inspection_table(artefact))
            line = Text("part: ").append(artefact.verdict, f"bold {COLOURS[artefact.verdict]}")
            console.print(line.append(one_line(f" ({artefact.reason})")), soft_wrap=True)
        if isinstance(artefact, Toolpath) and artefact is results.last(Toolpath):
            console.print(Text(one_line(path_summary(artefact))), soft_wrap=True)
        if isinstance(artefact, Moves):
            console.print(f"program: {len(artefact.feed_mm_s)} targets for {artefact.points_before} points")
        if isinstance(artefact, Rework):
            console.print(Text(one_line(f"rework: {artefact.reason}")), soft_wrap=True)
        if isinstance(artefact, Gate) and not any(artefact is one for one in listed):  # not where it is handed on alone
            listed.append(artefact)
            name = "gate" if gates == 1 else f"gate {stage}"
            console.print(Text(one_line(f"{name}: {gate_summary(artefact)}")), soft_wrap=True)


def print_files(results: Results) -> None:
    """Warnings, and where the results are."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    for note in results.warnings:
        console.print(Text(one_line(f"warning: {note}"), "yellow"), soft_wrap=True)
    for path in sorted(results.files, key=lambda path: path.suffix == ".html"):
        label = "report" if path.suffix == ".html" else "wrote"
        console.print(Text(one_line(f"{label}: {path}")), soft_wrap=True)
    causes = [gate.cause for gate in results.decisions if not gate.clean]
    if causes:
        console.print(Text(one_line(f"not passed: {causes[-1]}"), "red"), soft_wrap=True)


def inspection_summary(inspection: JointInspection) -> str:
    """What an inspection on the way to the finished part measured, in a line."""
    spans = []
    for one in inspection.characteristics:
        if values := [pair[0] for pair in one.pairs if pair]:
            digits, unit = (2, "deg") if one.is_angle else (3, "mm")
            spans.append(f"{one.term.lower()} {min(values):.{digits}f} to {max(values):.{digits}f} {unit}")
    return f"{', '.join(spans)}; as a finished part: {inspection.verdict}" if spans else "no section was measured"


def gate_summary(gate: Gate) -> str:
    """The decision and its reason in a line."""
    if gate.loosened and gate.passed:
        return f"loosened, {gate.cause} ({gate.reason})"
    return f"{'passed' if gate.passed else 'rejected'} ({gate.reason})"


def path_summary(path: Toolpath) -> str:
    """The path in a line: layers, length of the edge, time and what equation (26) saves; what it leaves out."""
    saved = 1.0 - path.time_s / path.time_at_v_slow_s
    points = sum(len(layer.feed_mm_s) for layer in path.layers)
    left = f"; not milled: {'; '.join(path.refused)}" if path.refused else ""
    time = f"{path.time_s / 60.0:.1f} min ({100.0 * saved:.0f} % less than at {path.v_slow_mm_s:g} mm/s throughout)"
    return f"path: {len(path.layers)} layers, {points} points on {path.edge_length_mm:.1f} mm of edge, {time}{left}"


def _inspection_table(inspection: JointInspection) -> Table:
    from rich.table import Table
    from rich.text import Text

    found = inspection.characteristics
    shown = [one for one in found if one.required] or list(found)
    table = Table(caption="± U: expanded uncertainty, U = 2u", caption_justify="left")
    for title in ("section", "arc length, mm", *map(_title, shown)):
        table.add_column(title, justify="right")
    table.add_column("verdict")
    for k, section in enumerate(inspection.sections):
        values = [_value(one.pairs[k]) for one in shown]
        verdict = Text(section.verdict, COLOURS[section.verdict])
        table.add_row(str(section.index), f"{section.arc_length_mm:.2f}", *values, verdict)
    return table


def _title(one: Characteristic) -> str:
    title = f"{one.term.lower()}, {one.quantity.unit}"
    if one.required is None:
        return title
    nominal, (lower, upper) = one.required
    return f"{title}\n{nominal:g} {lower:+g} {upper:+g}"


def _value(pair: tuple[float, float] | None) -> str:
    return "not measured" if pair is None else f"{pair[0]:.3f} ± {2 * pair[1]:.3f}"


def print_stage(stage: Stage) -> None:
    """One stage: what it does, takes, makes and its parameters with units and defaults."""
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False)
    console.print(Text(stage.name, "bold"))
    console.print(Text(prose(stage) + "\n"), soft_wrap=True)
    for source in stage.sources:
        console.print(Text(f"takes {source.name}: {source_text(source)}"))
    console.print(Text(f"makes {makes(stage)}"))
    for one in parameter_texts(stage):
        default = one.default if one.default == "required" else f"default {one.default}"
        facts = [one.type, one.unit, one.range, default]
        console.print(Text(f"\n{one.name}", "bold").append(f"  ({', '.join(filter(None, facts))})", "not bold"))
        if one.description:
            console.print(Text(f"    {one.description}"), soft_wrap=True)


def print_plan(name: Path, count: int, warnings: tuple[str, ...]) -> None:
    """That a pipeline is valid."""
    for note in warnings:
        print(one_line(f"warning: {note}"))
    print(one_line(f"{name}: valid, {count} stages"))
