"""The command line: `workbench run | validate | stages | schema | simulate | samples`.

Exit status: 0 it ran to the end; 1 it ran to the end and a gate rejected the part; 2 the input, the pipeline or the
arguments are unusable: one `error:` line on standard error. Only what the help needs is imported here.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable
from typing import Any, TextIO

from workbench.arguments import assignments, build_parser, parse


def run(options: argparse.Namespace) -> int:
    """Run a pipeline: results as files and as a table, progress on standard error."""
    from workbench.pipeline import Pipeline
    from workbench.pipeline.progress import Lines
    from workbench.pipeline.tables import print_results

    lines = Lines(sys.stderr)
    try:
        results = Pipeline.load(options.pipeline).run(
            options.out,
            inputs=assignments(options.input, "--input"),
            settings=assignments(options.set, "--set"),
            reporter=lines,
        )
    except BaseException:
        lines.close()
        raise
    printed(print_results, results)
    return 0 if results.passed else 1


def batch(options: argparse.Namespace) -> int:
    """Run a pipeline once for each recording."""
    from workbench.batch import run_batch
    from workbench.batch.table import print_batch
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
        progress=sys.stderr,
    )
    printed(print_batch, made)
    if made.exit_status == 2:
        print(one_line(f"error: {made.failure}"), file=sys.stderr)
    return made.exit_status


def validate(options: argparse.Namespace) -> int:
    """Check a pipeline without running it."""
    from workbench.pipeline import Pipeline
    from workbench.pipeline.tables import print_plan

    plan = Pipeline.load(options.pipeline).plan(
        assignments(options.input, "--input"), assignments(options.set, "--set")
    )
    printed(print_plan, options.pipeline, len(plan.steps), plan.warnings)
    return 0


def stages(options: argparse.Namespace) -> int:
    """List the stages, or describe one."""
    from workbench.errors import one_line
    from workbench.pipeline.registry import every_stage, find
    from workbench.pipeline.tables import print_stage, print_stages

    if options.name:
        printed(print_stage, find(options.name, "workbench stages"))
        return 0
    known, broken = every_stage()
    for why in broken.values():
        print(one_line(f"warning: {why}"), file=sys.stderr)
    printed(print_stages, known)
    return 0


def schema(options: argparse.Namespace) -> int:
    """Print the JSON Schema of a pipeline."""
    import json

    from workbench.pipeline.registry import every_stage
    from workbench.pipeline.schema import pipeline_schema

    printed(print, json.dumps(pipeline_schema(every_stage()[0]), indent=2))
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
    from workbench.importing.command import import_files

    understood = import_files(options.source, options.out, options.mapping)
    printed(print, "\n".join([*understood.lines, f"recording: {options.out}"]))
    return 0


def view_cell(options: argparse.Namespace) -> int:
    """Draw a robot cell in a posture, and tell its limits, reach, warnings and clearance."""
    from workbench.robot.view_cell import view_cell

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
            from workbench.errors import OutputError

            raise OutputError("standard output", f"cannot be written: {error.strerror}") from None


def set_aside(argv: list[str]) -> None:
    """After a run that failed: no earlier result may stand where a reader takes it for this run's."""
    from workbench.errors import WorkbenchError, one_line
    from workbench.pipeline.output import OutputDirectory

    out = next((b for a, b in zip(argv, argv[1:], strict=False) if a == "--out"), None)  # noqa: RUF007
    out = out or next((text[6:] for text in argv if text.startswith("--out=")), None)
    try:
        aside = OutputDirectory(out).supersede() if out and argv[0] == "run" else None
    except WorkbenchError:
        return  # not writable: the error line says so
    if aside:
        with contextlib.suppress(OSError):
            print(one_line(f"note: the results of an earlier run were moved to {aside}"), file=sys.stderr)


def complain(error: Exception, traceback: bool) -> int:
    """One `error:` line."""
    from workbench.errors import WorkbenchError, one_line

    if traceback:
        import traceback as tracebacks

        tracebacks.print_exception(error)
    known = isinstance(error, WorkbenchError)
    text = str(error) if known else f"internal: {type(error).__name__}: {error} (--traceback shows where)"
    with contextlib.suppress(OSError):  # nobody to tell: the exit status says it
        print(f"error: {one_line(text)}", file=sys.stderr)
    return 2


def without_command(options: argparse.Namespace) -> int:
    """`workbench --version`, or `workbench` alone."""
    if not options.version:
        build_parser().error(f"expected a command: {', '.join(COMMANDS)} (--help shows more)")
    from workbench import __version__

    print(f"workbench {__version__}")
    return 0


def interruptibly(action: Callable[[argparse.Namespace], int], options: argparse.Namespace) -> int:
    """Run a command so that SIGTERM and SIGHUP end it as Ctrl-C does: in order, leaving nothing half-written."""
    import signal
    import threading

    def stop(number: int, frame: object) -> None:
        raise KeyboardInterrupt(number)

    if threading.current_thread() is not threading.main_thread():
        return action(options)
    before = {number: signal.signal(number, stop) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        return action(options)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def prepare_streams() -> None:
    """Closed streams lead nowhere; a terminal without ± or ° gets them in ASCII."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 (for as long as the process lives)
        if hasattr(getattr(sys, name), "reconfigure"):
            getattr(sys, name).reconfigure(errors="backslashreplace")


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    argv = sys.argv[1:] if argv is None else argv
    prepare_streams()
    try:
        return answered(argv)
    finally:
        abandon_if_full(sys.stderr)


def abandon_if_full(stream: TextIO) -> None:
    """Let a stream that cannot be written lead nowhere: else the interpreter's last flush decides the exit status."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        stream.flush()


def answered(argv: list[str]) -> int:
    """Run the command, every error told in one line; returns the exit status."""
    try:
        options = parse(argv, COMMANDS)
        return interruptibly(COMMANDS[options.command], options) if options.command else without_command(options)
    except SystemExit as done:  # --help
        return int(done.code or 0)
    except KeyboardInterrupt as stop:
        print("interrupted", file=sys.stderr)
        return 128 + (stop.args[0] if stop.args else 2)
    except Exception as error:
        status = complain(error, "--traceback" in argv)
        set_aside(argv)
        return status
