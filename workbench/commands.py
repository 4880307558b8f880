"""What each command does: a function of its arguments that returns the exit status. Imports wait until it is called."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from typing import Any

from workbench.arguments import assignments
from workbench.errors import ArgumentError, nearest


def run(options: argparse.Namespace) -> int:
    """Run a pipeline: results as files and as a table, progress on standard error."""
    from workbench.errors import StreamError
    from workbench.pipeline import Pipeline
    from workbench.pipeline.progress import Lines
    from workbench.pipeline.tables import print_files, print_findings

    load_plugins(options)
    unprintable: list[StreamError] = []

    class Told(Lines):
        def known(self, results: Any) -> None:
            """Tell the verdict before the pictures are drawn; the results are written even if nobody can be told."""
            try:
                printed(print_findings, results)
            except StreamError as error:
                unprintable.append(error)

    lines = Told(sys.stderr)
    inputs, settings = assignments(options.input, "--input"), assignments(options.set, "--set")
    try:
        pipeline = Pipeline.load(options.pipeline)
        if options.follow:
            followed(options, pipeline, inputs, settings)
        results = pipeline.run(
            options.out,
            inputs=inputs,
            settings=settings,
            reporter=lines,
            report=not options.no_report,
            cache=options.cache,
        )
    except BaseException:
        lines.close()
        raise
    for error in unprintable:
        raise error
    printed(print_files, results)
    return 0 if results.passed else 1


def followed(options: argparse.Namespace, pipeline: Any, inputs: dict[str, Any], settings: dict[str, Any]) -> None:
    """Wait for the recording of `--follow`, which becomes the pipeline's input."""
    from pathlib import Path

    from workbench.pipeline.follow import RECORDING, follow

    if RECORDING in inputs:
        raise ArgumentError("--follow", f"names the recording; leave out --input {RECORDING}=")
    follow(pipeline, Path(options.follow), options.stall_s, lambda text: print(text, file=sys.stderr), inputs, settings)
    inputs[RECORDING] = options.follow


def load_plugins(options: argparse.Namespace) -> None:
    """Make the stages of `--plugin FILE.py` known."""
    if options.plugin:
        from workbench.pipeline.catalogue import load_file

        for path in options.plugin:
            load_file(path)


def batch(options: argparse.Namespace) -> int:
    """Run a pipeline once for each recording."""
    from workbench.batch import run_batch
    from workbench.batch.run import print_batch
    from workbench.errors import one_line

    made = run_batch(
        options.pipeline,
        options.recordings,
        options.out,
        workers=options.workers,
        scheduler=options.scheduler,
        time_limit_s=options.time_limit_s,
        inputs=assignments(options.input, "--input"),
        settings=assignments(options.set, "--set"),
        cache=options.cache,
        report=not options.no_report,
        progress=sys.stderr,
    )
    printed(print_batch, made)
    if made.exit_status == 2:
        print(one_line(f"error: {made.failure}"), file=sys.stderr)
    return made.exit_status


def validate(options: argparse.Namespace) -> int:
    """Check a pipeline without running it."""
    load_plugins(options)
    from workbench.pipeline import Pipeline
    from workbench.pipeline.tables import print_plan

    plan = Pipeline.load(options.pipeline).plan(
        assignments(options.input, "--input"), assignments(options.set, "--set")
    )
    printed(print_plan, options.pipeline, len(plan.steps), plan.warnings)
    return 0


def stages(options: argparse.Namespace) -> int:
    """List the stages, or describe one."""
    load_plugins(options)
    from workbench.errors import one_line
    from workbench.pipeline.catalogue import catalogue, find, print_stages

    if options.name:
        from workbench.pipeline.tables import print_stage

        printed(print_stage, find(options.name, "workbench stages"))
        return 0
    found = catalogue()
    for why in found.broken.values():
        print(one_line(f"warning: {why}"), file=sys.stderr)
    printed(print_stages, found)
    return 0


def _result_schema(name: str) -> dict[str, Any]:
    from workbench.result_files import RESULT_FILES, result_schema

    known = name if name.endswith(".json") else f"{name}.json"
    if known not in RESULT_FILES:
        raise ArgumentError(f"schema {name}", f"no such result file{nearest(known, RESULT_FILES)}")
    return result_schema(known)


def schema(options: argparse.Namespace) -> int:
    """Print the JSON Schema of a pipeline, or of a result file."""
    import json

    if options.result is not None:
        printed(print, json.dumps(_result_schema(options.result), indent=2))
        return 0

    from workbench.pipeline.catalogue import catalogue

    printed(print, json.dumps(catalogue().schema, indent=2))
    return 0


def simulate(options: argparse.Namespace) -> int:
    """Make a synthetic recording and its truth."""
    from workbench.pipeline.progress import Lines, compilation_watch
    from workbench.synthetic.simulate import simulate_file, truth_path

    lines = Lines(sys.stderr)

    def advance(done: int, count: int) -> None:
        if not lines.label:  # the recipe is read and found good
            lines.begin(0, 1, "simulate")
        lines.fraction(done / count)

    try:
        with compilation_watch(lines):
            simulate_file(options.recipe, options.out, advance)
    finally:
        lines.close()
    printed(print, f"recording: {options.out}\ntruth: {truth_path(options.out)}")
    return 0


def samples(options: argparse.Namespace) -> int:
    """Copy the shipped pipelines and data."""
    from pathlib import Path

    from workbench.samples import copy_samples

    for made in copy_samples(Path(options.directory)):
        printed(print, made)
    return 0


def import_(options: argparse.Namespace) -> int:
    """Make a recording of other people's files, and tell what was understood of them."""
    if options.draft:
        from workbench.importing.draft import draft_files

        printed(print, "\n".join(draft_files(options.source, options.out)))
        return 0
    from workbench.importing.command import import_files

    understood = import_files(options.source, options.out, options.mapping)
    made = "table" if understood.recording is None else "recording"
    printed(print, "\n".join([*understood.lines, f"{made}: {options.out}"]))
    return 0


def look(options: argparse.Namespace) -> int:
    """Tell and show what a recording, a cloud or a vendor's file holds; nothing is judged by the exit status."""
    from workbench.look import look as look_at

    lines = look_at(options.file, options.out, options.mapping, options.corners)
    printed(print, "\n".join([*lines, *([f"page: {options.out}"] if options.out else [])]))
    return 0


def view_cell(options: argparse.Namespace) -> int:
    """Draw a robot cell in a posture, and tell its limits, reach, warnings and clearance."""
    from workbench.robot.picture import view_cell

    printed(print, "\n".join(view_cell(options.cell, options.posture, options.turntable_deg, options.out)))
    return 0


def view(options: argparse.Namespace) -> int:
    """Serve the results in a directory to a browser on this machine, until Ctrl-C."""
    from pathlib import Path

    from workbench.view import serve

    def tell(address: str) -> None:
        printed(print, f"view: {address}\nCtrl-C ends it")

    try:
        serve(Path(options.directory), options.port, browser=not options.no_browser, tell=tell)
    except KeyboardInterrupt as stop:
        if stop.args:  # not Ctrl-C: a signal that asks for the end
            raise
    return 0


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "run": run,
    "validate": validate,
    "stages": stages,
    "schema": schema,
    "simulate": simulate,
    "batch": batch,
    "import": import_,
    "look": look,
    "samples": samples,
    "view": view,
    "view-cell": view_cell,
}


def printed(write: Callable[..., None], *what: Any) -> None:
    """Write to standard output; a reader that has gone away (`| head`) is no error, a full disk is."""
    try:
        write(*what)
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python tries again at its end
        if not isinstance(error, BrokenPipeError):
            from workbench.errors import StreamError

            raise StreamError("standard output", f"cannot be written: {error.strerror}") from None
