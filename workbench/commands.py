"""The command line: what it takes, and each command, a function of its arguments that returns the exit status.

A mistake is an error with the nearest known name. Imports wait until a command is called.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from workbench.errors import ArgumentError, PipelineError, StreamError, nearest, one_line
from workbench.extras import require

if TYPE_CHECKING:
    from collections.abc import Iterable


EXAMPLES = """examples:
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input recording=part-7.h5
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input 'root_tolerance_mm=[-0.3, 0.3]'
  workbench stages cloud.denoise

lengths in mm, times in s, angles in degrees where a name ends in _deg
exit status: 0 done, 1 done and not passed by the pipeline's gate, 2 unusable input or arguments"""
RUN_EXAMPLES = """examples:
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input recording=part-7.h5
  workbench run pipelines/inspect_bevel.json --out out/part-7 --input bevel_nominal_deg=37.5
  workbench run pipelines/inspect_bevel.json --out out/part-7 --set cloud.denoise.window_frames=9

VALUE is read as JSON if it parses, else as a text. A relative path is relative to the working directory here,
and to the pipeline's own file inside it. The units stand in the names: _mm, _deg, _s, _mm_s."""

BATCH_EXAMPLES = """examples:
  workbench batch pipelines/inspect_bevel.json parts/*.h5 --out out/july
  workbench batch pipelines/inspect_bevel.json parts/ --out out/july --workers 2 --input bevel_nominal_deg=37.5
  workbench batch pipelines/inspect_bevel.json 's3://bucket/july/*.h5' --out s3://bucket/results

Started again, it runs only the parts whose results are not there, not whole, or rest on other inputs or versions.
exit status: 0 all parts passed, 1 some were rejected, 2 some have no results (or unusable arguments)"""

NEGATIVE = re.compile(r"-\.?\d")  # argparse's own takes -10,20 for an option


class Parser(argparse.ArgumentParser):
    """argparse that raises instead of exiting, so that every error leaves by one door."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments."""
        raise ArgumentError(self.prog, message)


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
    examples = RUN_EXAMPLES.replace("workbench run", "workbench validate").replace("--out out/part-7 ", "")
    validate = command("validate", "check a pipeline without running it", examples)
    batch = command("batch", "run a pipeline for each recording, and make a page of the fleet", BATCH_EXAMPLES)
    for made in (run, validate, batch):
        made.add_argument("pipeline", metavar="PIPELINE.json", help="a file, or a shipped one's name")
        made.add_argument(
            "--input", action="append", default=[], metavar="NAME=VALUE", help="replace an input of the pipeline"
        )
        made.add_argument(
            "--set", action="append", default=[], metavar="STAGE.KEY=VALUE", help="replace a stage's parameter"
        )
    for made in (run, batch):
        made.add_argument("--store", metavar="FOLDER", help="add it to the history of `workbench open FOLDER`")
        made.add_argument("--no-report", action="store_true", help="without report.html")
    batch.add_argument(
        "recordings",
        nargs="+",
        metavar="RECORDING",
        help="file, folder of .h5 files or URL, * for many, in order of production",
    )
    batch.add_argument("--out", required=True, metavar="DIR", help="folder or URL: DIR/PART/ for each, DIR/fleet.html")
    where = batch.add_mutually_exclusive_group()
    where.add_argument("--workers", type=_count, metavar="N", help="processes (default: one per core); 0: this one")
    where.add_argument("--scheduler", metavar="URL", help="dask scheduler, tcp://HOST:PORT (extra [cluster])")
    batch.add_argument("--time-limit-s", type=_seconds, default=600.0, metavar="S", help="for each part (default: 600)")
    batch.add_argument("--cache", metavar="FOLDER", help="keep copies of recordings behind URLs here")
    run.add_argument("--out", metavar="DIR", help="directory for the results (default: results/PIPELINE)")
    run.add_argument("--follow", metavar="FILE.h5", help="the recording, which may still be growing: wait for its end")
    run.add_argument("--drawing", metavar="FILE.svg", help="with --follow: draw the sections of the frames so far")
    run.add_argument(
        "--stall-s", type=_seconds, default=10.0, metavar="S", help="with --follow: longest pause (default: 10)"
    )
    run.add_argument("--cache", metavar="DIR", help="keep results of stages; the next run computes only what changed")
    stages = command("stages", "list the stages, plug-ins included, or describe one with its parameters and units")
    stages.add_argument("name", nargs="?", metavar="NAME")
    schema = command("schema", "print the JSON Schema of a pipeline, for editors, or of a result file")
    schema.add_argument("result", nargs="?", metavar="RESULT", help="such as inspection.json")
    for made in (run, validate, stages):
        made.add_argument(
            "--plugin", action="append", default=[], metavar="FILE.py", help="stages in a file of your own"
        )
    simulate = command("simulate", "make a synthetic recording, and its truth in FILE.truth.json")
    simulate.add_argument("recipe", metavar="RECIPE.json")
    simulate.add_argument("--out", required=True, metavar="FILE.h5", help="the recording to write")
    imported = command("import", "make a recording of profile files and pose files (docs/importing.md)")
    imported.add_argument("source", nargs="+", metavar="SOURCE", help="profiles, poses, or both")
    imported.add_argument(
        "--out",
        required=True,
        metavar="FILE.h5",
        help="the recording; for a tracker's readings FILE.csv; with --draft MAP.json",
    )
    imported.add_argument("--draft", action="store_true", help="write a mapping to confirm, with what was recognised")
    imported.add_argument("--mapping", metavar="MAP.json", help="what the files do not say about themselves")
    looked = command("look", "show the contents of a recording, a cloud or a vendor's file, and failed checks")
    looked.add_argument("file", metavar="FILE", help="recording (.h5), cloud, or what `workbench import` reads")
    looked.add_argument("--out", metavar="FILE.html", help="the page to write, with the view in space")
    looked.add_argument("--mapping", metavar="MAP.json", help="what the file does not say about itself")
    looked.add_argument("--corners", metavar="FILE.csv", help="a groove's corners in every row of ranges, as a table")
    scored = command("score", "score results of any program against the truth (docs/benchmark.md)")
    scored.add_argument(
        "submission", metavar="SUBMISSION.json", help="values with their u (workbench schema submission)"
    )
    scored.add_argument("truth", metavar="TRUTH", help="truth file, or the folder of a track with its truth.json")
    scored.add_argument("--out", metavar="DIR", help="folder for card.json, card.html and card.svg")
    samples = command("samples", "copy the shipped pipelines and sample data into a directory")
    samples.add_argument("directory", metavar="DIR")
    viewed = command("view", "show the report and the results in DIR in a browser, served on 127.0.0.1 until Ctrl-C")
    viewed.add_argument("directory", metavar="DIR")
    opened = command("open", "the workbench's page in a browser: look, inspect, plan, and find results of a folder")
    opened.add_argument(
        "directory", metavar="FOLDER", nargs="?", default=".", help="with recordings (default: this one)"
    )
    for made in (viewed, opened):
        made.add_argument("--port", type=_port, default=0, metavar="N", help="port to listen on (default: a free one)")
        made.add_argument("--no-browser", action="store_true", help="print the address only")
    completed = command("completion", "print the script by which a shell completes commands, options and pipelines")
    completed.add_argument("shell", choices=("bash", "zsh"), help='such as: eval "$(workbench completion bash)"')
    shown = command("view-cell", "show a robot cell in a posture; print its limits, reach, warnings and clearance")
    shown._negative_number_matcher = NEGATIVE
    shown.add_argument("cell", metavar="CELL", help="the cell file (data/robot/README.md)")
    shown.add_argument(
        "--posture", default="0,0,0,0,0,0", metavar="Q1,...,Q6", help="joint angles, deg (default: all 0)"
    )
    shown.add_argument("--turntable-deg", type=float, default=0.0, metavar="A", help="turntable's angle (default: 0)")
    shown.add_argument("--tilt-deg", type=float, default=0.0, metavar="A", help="its tilt's angle (default: 0)")
    shown.add_argument("--out", required=True, metavar="FILE.html", help="the page to write, with the view in space")
    return parser


def _port(text: str) -> int:
    """A port's number, 0 for any free one; argparse tells what is wrong with another."""
    if not text.isdecimal() or int(text[:6]) > 65_535:
        raise argparse.ArgumentTypeError(f"expected a port from 0 to 65535, got '{text}'")
    return int(text)


def _count(text: str) -> int:
    """A whole number from 0; argparse tells what is wrong with another."""
    if not text.isdecimal() or len(text) > 4:
        raise argparse.ArgumentTypeError(f"expected a whole number, 0 or more, got '{text}'")
    return int(text)


def _seconds(text: str) -> float:
    """A time above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"expected a time in s above 0, got '{text}'")
    return value


def parse(argv: list[str], commands: Iterable[str]) -> argparse.Namespace:
    """Read the arguments; raises PipelineError with the nearest known name."""
    parser = build_parser()
    if argv and not argv[0].startswith("-") and argv[0] not in commands:
        parser.error(f"unknown command '{argv[0]}'{nearest(argv[0], commands)}")
    options, rest = parser.parse_known_args(argv)
    if rest:
        known = option_words(parser, options.command)
        what = (
            f"unknown option '{rest[0]}'{nearest(rest[0], known)}"
            if rest[0][:1] == "-"
            else f"one argument too many: '{rest[0]}'; a name or a value with blanks is quoted, as 'part 7.h5'"
        )
        parser.error(what)
    return options


def option_words(parser: argparse.ArgumentParser, command: str | None) -> list[str]:
    """The options of a command, or those before one."""
    actions = subparsers(parser)[command]._actions if command else parser._actions
    return [text for action in actions for text in action.option_strings if text.startswith("--")]


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Each command's own parser."""
    (found,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    return found.choices


def assignments(texts: list[str], option: str) -> dict[str, Any]:
    """`NAME=VALUE` texts as values by name: VALUE as JSON if it parses, else as it stands."""
    from workbench.pipeline.document import parse_json

    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise ArgumentError(f"{option} '{text}'", "expected NAME=VALUE")
        if name in values:
            raise ArgumentError(f"{option} '{text}'", f"'{name}' is given twice")
        try:
            values[name] = parse_json(value.encode(), option)
        except (PipelineError, UnicodeEncodeError):
            values[name] = value
    return values


def run(options: argparse.Namespace) -> int:
    """Run a pipeline: results as files and as a table, progress on standard error."""
    from workbench.pipeline import Pipeline
    from workbench.pipeline.terminal import Lines, print_files, print_findings
    from workbench.samples import shipped_pipeline

    load_plugins(options)
    unprintable: list[StreamError] = []

    class EarlyVerdict(Lines):
        def known(self, results: Any) -> None:
            """Print the verdict before the pictures are drawn; the results are written even if nobody can read it."""
            try:
                printed(print_findings, results)
            except StreamError as error:
                unprintable.append(error)

    lines, out = EarlyVerdict(sys.stderr), default_out(options.pipeline) if options.out is None else options.out
    check_store(options)
    inputs, settings = assignments(options.input, "--input"), assignments(options.set, "--set")
    try:
        pipeline = Pipeline.load(shipped_pipeline(options.pipeline))
        if options.follow:
            followed(options, pipeline, inputs, settings)
        results = pipeline.run(
            out,
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
    status = 0 if results.passed else 1
    if options.store:
        from workbench.page.records import keep_run

        keep_run(options.store, bare_name(options.pipeline), inputs, status, Path(out))
    return status


def bare_name(pipeline: str) -> str:
    """A pipeline's name, for a file or a shipped one."""
    return re.split(r"[/\\]", pipeline)[-1].removesuffix(".json")


def default_out(pipeline: str) -> str:
    """Where a run writes that is not told."""
    return f"results/{bare_name(pipeline)}"


def check_store(options: argparse.Namespace) -> None:
    """Refuse a folder of `--store` that can take nothing, before anything is measured."""
    if options.store:
        from workbench.page.store import Store

        Store.of(Path(options.store)).close()


def followed(options: argparse.Namespace, pipeline: Any, inputs: dict[str, Any], settings: dict[str, Any]) -> None:
    """Wait for the recording of `--follow`, which becomes the pipeline's input."""
    from workbench.pipeline.follow import RECORDING, follow

    if RECORDING in inputs:
        raise ArgumentError("--follow", f"names the recording; leave out --input {RECORDING}=")
    drawing = Path(options.drawing) if options.drawing else None

    def tell(text: str) -> None:
        print(text, file=sys.stderr)

    follow(pipeline, Path(options.follow), options.stall_s, tell, inputs, settings, drawing)
    inputs[RECORDING] = options.follow


def load_plugins(options: argparse.Namespace) -> None:
    """Make the stages of `--plugin FILE.py` known."""
    if options.plugin:
        from workbench.pipeline.catalogue import load_file

        for path in options.plugin:
            load_file(path)


def batch(options: argparse.Namespace) -> int:
    """Run a pipeline once for each recording."""
    check_store(options)
    from workbench.batch import run_batch
    from workbench.batch.run import print_batch
    from workbench.samples import shipped_pipeline

    made = run_batch(
        shipped_pipeline(options.pipeline),
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
    if options.store:
        from workbench.page.records import keep_batch

        keep_batch(
            options.store, bare_name(options.pipeline), assignments(options.input, "--input"), made.records, options.out
        )
    printed(print_batch, made)
    if made.exit_status == 2:
        print(one_line(f"error: {made.failure}"), file=sys.stderr)
    return made.exit_status


def validate(options: argparse.Namespace) -> int:
    """Check a pipeline without running it."""
    load_plugins(options)
    from workbench.pipeline import Pipeline
    from workbench.pipeline.terminal import print_plan
    from workbench.samples import shipped_pipeline

    plan = Pipeline.load(shipped_pipeline(options.pipeline)).plan(
        assignments(options.input, "--input"), assignments(options.set, "--set")
    )
    printed(print_plan, options.pipeline, len(plan.steps), plan.warnings)
    return 0


def stages(options: argparse.Namespace) -> int:
    """List the stages, or describe one."""
    load_plugins(options)
    from workbench.pipeline.catalogue import catalogue, find, print_stages

    if options.name:
        from workbench.pipeline.terminal import print_stage

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
    from workbench.pipeline.terminal import Lines, compilation_watch
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


def score(options: argparse.Namespace) -> int:
    """Print the score card of a submission; with --out, write it too."""
    from workbench.score.command import score as scored

    out = Path(options.out) if options.out else None
    printed(print, scored(Path(options.submission), Path(options.truth), out))
    return 0


def samples(options: argparse.Namespace) -> int:
    """Copy the shipped pipelines and data."""
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


def completion(options: argparse.Namespace) -> int:
    """Print a script for the shell: words of each command, and files."""
    from workbench.samples import pipelines

    parser, cases = build_parser(), []
    commands = list(subparsers(parser))
    for name in commands:
        words = option_words(parser, name) + (pipelines() if name in ("run", "validate", "batch") else [])
        cases.append(f'    {name}) words="{" ".join(words)}" ;;')
    head = "autoload -U +X bashcompinit && bashcompinit\n" if options.shell == "zsh" else ""
    lines = "\n".join(cases)
    script = f"""{head}_workbench() {{
  local words="{" ".join(commands)}"
  if [ "$COMP_CWORD" -gt 1 ]; then case "${{COMP_WORDS[1]}}" in
{lines}
  esac; fi
  COMPREPLY=($(compgen -W "$words" -- "${{COMP_WORDS[COMP_CWORD]}}") $(compgen -f -- "${{COMP_WORDS[COMP_CWORD]}}"))
}}
complete -o filenames -F _workbench workbench"""
    printed(print, script)
    return 0


def view_cell(options: argparse.Namespace) -> int:
    """Show a robot cell in a posture, and print its limits, reach, warnings and clearance."""
    from workbench.look.cell import view_cell

    where = options.posture, options.turntable_deg, options.out, options.tilt_deg
    printed(print, "\n".join(view_cell(options.cell, *where)))
    return 0


def view(options: argparse.Namespace) -> int:
    """Serve the results in a directory to a browser on this machine, until Ctrl-C."""
    require("starlette", "uvicorn")
    from workbench.view import serve

    return served(serve, options)


def open_page(options: argparse.Namespace) -> int:
    """Serve the workbench's page of a folder to a browser on this machine, until Ctrl-C."""
    require("starlette", "uvicorn")
    from workbench.page import serve

    return served(serve, options)


def served(serve: Callable[..., None], options: argparse.Namespace) -> int:
    """Serve until somebody ends it, and tell the address."""

    def tell(address: str) -> None:
        printed(print, f"{options.command}: {address}\nCtrl-C ends it")

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
    "score": score,
    "samples": samples,
    "view": view,
    "open": open_page,
    "view-cell": view_cell,
    "completion": completion,
}


def printed(write: Callable[..., None], *what: Any) -> None:
    """Write to standard output; a reader that has gone away (`| head`) is no error, a full disk is."""
    try:
        write(*what)
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # else Python tries again at its end
        if not isinstance(error, BrokenPipeError):
            raise StreamError("standard output", f"cannot be written: {error.strerror}") from None
