"""What the command line takes: commands, options, their help; every mistake an error with the nearest known name."""

from __future__ import annotations

import argparse
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
    samples = command("samples", "copy the pipelines and the sample data that come with the project into a directory")
    samples.add_argument("directory", metavar="DIR")
    return parser


def parse(argv: list[str], commands: Iterable[str]) -> argparse.Namespace:
    """Read the arguments; raises PipelineError with the nearest known name."""
    parser = build_parser()
    if argv and not argv[0].startswith("-") and argv[0] not in commands:
        from workbench.errors import nearest

        parser.error(f"unknown command '{argv[0]}'{nearest(argv[0], commands)}")
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
