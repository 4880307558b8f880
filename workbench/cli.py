"""The command line: `workbench run | validate | stages | schema | simulate`.

Exit status: 0 it ran to the end; 1 it ran to the end and a gate rejected the part; 2 the input, the pipeline or the
arguments are unusable: one `error:` line on standard error. Only what the help needs is imported here.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn

EXAMPLES = """examples:
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input recording=part-7.h5
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input 'root_tolerance_mm=[-0.3, 0.3]'
  workbench stages cloud.denoise

lengths in mm, times in s, angles in degrees where a name ends in _deg
exit status: 0 done, 1 done and the part rejected by the pipeline's gate, 2 unusable input or arguments"""
RUN_EXAMPLES = """examples:
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input recording=part-7.h5
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input bevel_nominal_deg=37.5
  workbench run pipelines/inspect_bevel.json --out out/part-7 --set cloud.denoise.window_frames=9

VALUE is read as JSON if it parses, else as a text. A relative path is relative to the working directory here,
and to the pipeline's own file inside it. The units stand in the names: _mm, _deg, _s, _mm_s."""


class Parser(argparse.ArgumentParser):
    """argparse that raises instead of exiting, so that every error leaves by one door."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments."""
        from workbench.errors import PipelineError

        raise PipelineError(self.prog, message)


def build_parser() -> Parser:
    """The commands and their arguments."""
    layout: dict[str, Any] = {"formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False}
    parser = Parser(
        prog="workbench", description="Point-cloud workbench for robotic bevel milling.", epilog=EXAMPLES, **layout
    )
    parser.add_argument("--version", action="store_true", help="print the version")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")

    def command(name: str, text: str, epilog: str | None = None) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=text, description=text, epilog=epilog, **layout)
        made.add_argument("--traceback", action="store_true", help="show where in the program an error arose")
        return made

    run = command("run", "run a pipeline and write its results", RUN_EXAMPLES)
    validate = command("validate", "check all of a pipeline that can be checked without running it", RUN_EXAMPLES)
    for made in (run, validate):
        made.add_argument("pipeline", metavar="PIPELINE.json")
        made.add_argument(
            "--input", action="append", default=[], metavar="NAME=VALUE", help="replace an input of the pipeline"
        )
        made.add_argument(
            "--set", action="append", default=[], metavar="STAGE.KEY=VALUE", help="replace a stage's parameter"
        )
    run.add_argument("--out", required=True, metavar="DIR", help="directory for the results")
    stages = command("stages", "list the stages, plug-ins included, or describe one with its parameters and units")
    stages.add_argument("name", nargs="?", metavar="NAME")
    command("schema", "print the JSON Schema of a pipeline, for editors")
    simulate = command("simulate", "make a synthetic recording; its truth goes beside it, into FILE.truth.json")
    simulate.add_argument("recipe", metavar="RECIPE.json")
    simulate.add_argument("--out", required=True, metavar="FILE.h5", help="the recording to write")
    return parser


def parse(argv: list[str]) -> argparse.Namespace:
    """Read the arguments; raises PipelineError with the nearest known name."""
    parser = build_parser()
    if argv and not argv[0].startswith("-") and argv[0] not in COMMANDS:
        from workbench.errors import nearest

        parser.error(f"unknown command '{argv[0]}'{nearest(argv[0], COMMANDS)}")
    options, rest = parser.parse_known_args(argv)
    if rest:
        from workbench.errors import nearest

        known = ["--" + name for name in vars(options) if name in ("input", "set", "out", "traceback", "version")]
        what = (
            f"unknown option '{rest[0]}'{nearest(rest[0], known)}"
            if rest[0][:1] == "-"
            else f"one argument too many: '{rest[0]}'"
        )
        parser.error(what)
    return options


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


COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    "run": run,
    "validate": validate,
    "stages": stages,
    "schema": schema,
    "simulate": simulate,
}


def assignments(texts: list[str], option: str) -> dict[str, Any]:
    """`NAME=VALUE` texts as values by name: VALUE as JSON if it parses, else as it stands."""
    from workbench.errors import PipelineError
    from workbench.pipeline.document import parse_json

    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise PipelineError(f"{option} '{text}'", "expected NAME=VALUE")
        try:
            values[name] = parse_json(value.encode(), option)
        except (PipelineError, UnicodeEncodeError):
            values[name] = value
    return values


def printed(write: Callable[..., None], *what: Any) -> None:
    """Write to standard output; a reader that has gone away (`| head`) is no error."""
    try:
        write(*what)
        sys.stdout.flush()
    except BrokenPipeError:
        import os

        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def set_aside(argv: list[str]) -> None:
    """After a run that failed: no earlier result may stand where a reader takes it for this run's."""
    from pathlib import Path

    from workbench.errors import WorkbenchError, one_line
    from workbench.pipeline.output import OutputDirectory

    out = next((b for a, b in zip(argv, argv[1:], strict=False) if a == "--out"), None)  # noqa: RUF007
    out = out or next((text[6:] for text in argv if text.startswith("--out=")), None)
    try:
        aside = OutputDirectory(Path(out)).supersede() if out and argv[0] == "run" else None
    except WorkbenchError:
        return  # not writable: the error line says so
    if aside:
        print(one_line(f"note: the results of an earlier run were moved to {aside}"), file=sys.stderr)


def complain(error: Exception, traceback: bool) -> int:
    """One `error:` line."""
    from workbench.errors import WorkbenchError, one_line

    if traceback:
        import traceback as tracebacks

        tracebacks.print_exception(error)
    known = isinstance(error, WorkbenchError)
    text = str(error) if known else f"internal: {type(error).__name__}: {error} (--traceback shows where)"
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


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    argv = sys.argv[1:] if argv is None else argv
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a terminal without ± or ° gets them in ASCII
    try:
        options = parse(argv)
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
