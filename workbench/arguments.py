"""What the command line takes: commands, options, their help; every mistake an error with the nearest known name."""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from collections.abc import Iterable

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

OPTIONS = (
    "input",
    "set",
    "out",
    "mapping",
    "traceback",
    "version",
    "workers",
    "scheduler",
    "time_limit_s",
    "cache",
    "plugin",
    "draft",
    "no_report",
    "follow",
    "stall_s",
    "posture",
    "turntable_deg",
    "port",
    "no_browser",
)
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
        from workbench.errors import ArgumentError

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
    validate = command("validate", "check all of a pipeline that can be checked without running it", RUN_EXAMPLES)
    batch = command("batch", "run a pipeline once for each recording, and make the page of the fleet", BATCH_EXAMPLES)
    for made in (run, validate, batch):
        made.add_argument("pipeline", metavar="PIPELINE.json")
        made.add_argument(
            "--input", action="append", default=[], metavar="NAME=VALUE", help="replace an input of the pipeline"
        )
        made.add_argument(
            "--set", action="append", default=[], metavar="STAGE.KEY=VALUE", help="replace a stage's parameter"
        )
    for made in (run, batch):
        made.add_argument("--no-report", action="store_true", help="measure and decide, but make no report.html")
    batch.add_argument(
        "recordings", nargs="+", metavar="RECORDING", help="file, folder of .h5 files or URL, in order of production"
    )
    batch.add_argument("--out", required=True, metavar="DIR", help="folder or URL: DIR/PART/ for each, DIR/fleet.html")
    where = batch.add_mutually_exclusive_group()
    where.add_argument("--workers", type=_count, metavar="N", help="processes (default: a core each); 0: in this one")
    where.add_argument("--scheduler", metavar="URL", help="dask scheduler, tcp://HOST:PORT (workbench[cluster])")
    batch.add_argument("--time-limit-s", type=_seconds, default=600.0, metavar="S", help="for each part (default: 600)")
    batch.add_argument("--cache", metavar="FOLDER", help="keep copies of recordings behind URLs here")
    run.add_argument("--out", required=True, metavar="DIR", help="directory for the results")
    run.add_argument("--follow", metavar="FILE.h5", help="the recording, which may still be growing: wait for its end")
    run.add_argument(
        "--stall-s", type=_seconds, default=10.0, metavar="S", help="with --follow: longest pause (default: 10)"
    )
    run.add_argument("--cache", metavar="DIR", help="keep here what stages made; the next run computes what changed")
    stages = command("stages", "list the stages, plug-ins included, or describe one with its parameters and units")
    stages.add_argument("name", nargs="?", metavar="NAME")
    schema = command("schema", "print the JSON Schema of a pipeline, for editors, or of a result file")
    schema.add_argument("result", nargs="?", metavar="RESULT", help="such as inspection.json")
    for made in (run, validate, stages):
        made.add_argument(
            "--plugin", action="append", default=[], metavar="FILE.py", help="stages in a file of your own"
        )
    simulate = command("simulate", "make a synthetic recording; its truth goes beside it, into FILE.truth.json")
    simulate.add_argument("recipe", metavar="RECIPE.json")
    simulate.add_argument("--out", required=True, metavar="FILE.h5", help="the recording to write")
    imported = command("import", "make a recording of profile files, pose files and bags (docs/importing.md)")
    imported.add_argument("source", nargs="+", metavar="SOURCE", help="profiles, poses, or a bag of both")
    imported.add_argument(
        "--out",
        required=True,
        metavar="FILE.h5",
        help="what to write: the recording; of a tracker's readings FILE.csv; with --draft MAP.json",
    )
    imported.add_argument("--draft", action="store_true", help="write what was understood as a mapping to confirm")
    imported.add_argument("--mapping", metavar="MAP.json", help="what the files do not say about themselves")
    looked = command("look", "show what a recording, a cloud or a vendor's file holds, and what speaks against it")
    looked.add_argument("file", metavar="FILE", help="recording (.h5), cloud, or what `workbench import` reads")
    looked.add_argument("--out", metavar="FILE.html", help="the page to write, with the view in space")
    looked.add_argument("--mapping", metavar="MAP.json", help="what the file does not say about itself")
    looked.add_argument("--corners", metavar="FILE.csv", help="a groove's corners in every row of ranges, as a table")
    samples = command("samples", "copy the pipelines and the sample data that come with the project into a directory")
    samples.add_argument("directory", metavar="DIR")
    viewed = command("view", "show the report and the results in DIR in a browser, served on 127.0.0.1 until Ctrl-C")
    viewed.add_argument("directory", metavar="DIR")
    viewed.add_argument("--port", type=_port, default=0, metavar="N", help="port to listen on (default: a free one)")
    viewed.add_argument("--no-browser", action="store_true", help="print the address only")
    shown = command("view-cell", "draw a robot cell in a posture; tell its limits, reach, warnings and clearance")
    shown._negative_number_matcher = NEGATIVE
    shown.add_argument("cell", metavar="CELL", help="the cell file, JSON or YAML (data/robot/README.md)")
    shown.add_argument(
        "--posture", default="0,0,0,0,0,0", metavar="Q1,...,Q6", help="joint angles, deg (default: all 0)"
    )
    shown.add_argument("--turntable-deg", type=float, default=0.0, metavar="A", help="turntable's angle (default: 0)")
    shown.add_argument("--out", required=True, metavar="PICTURE.png", help="the picture to write")
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
        from workbench.errors import nearest

        parser.error(f"unknown command '{argv[0]}'{nearest(argv[0], commands)}")
    options, rest = parser.parse_known_args(argv)
    if rest:
        from workbench.errors import nearest

        known = ["--" + name.replace("_", "-") for name in vars(options) if name in OPTIONS]
        what = (
            f"unknown option '{rest[0]}'{nearest(rest[0], known)}"
            if rest[0][:1] == "-"
            else f"one argument too many: '{rest[0]}'"
        )
        parser.error(what)
    return options


def assignments(texts: list[str], option: str) -> dict[str, Any]:
    """`NAME=VALUE` texts as values by name: VALUE as JSON if it parses, else as it stands."""
    from workbench.errors import ArgumentError, PipelineError
    from workbench.pipeline.document import parse_json

    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise ArgumentError(f"{option} '{text}'", "expected NAME=VALUE")
        try:
            values[name] = parse_json(value.encode(), option)
        except (PipelineError, UnicodeEncodeError):
            values[name] = value
    return values
