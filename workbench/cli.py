"""The command line: `workbench COMMAND ...`.

Exit status: 0 it ran to the end; 1 it ran to the end and a gate rejected the part; 2 the input, the pipeline or the
arguments are unusable: one `error:` line on standard error. Only what the help needs is imported here.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import sys
from collections.abc import Callable
from typing import NoReturn, TextIO

from workbench.commands import COMMANDS, build_parser, default_out, parse


def supersede(argv: list[str]) -> None:
    """After a run that failed: no earlier result may stand where a reader takes it for this run's."""
    from workbench.errors import WorkbenchError, one_line
    from workbench.pipeline.output import OutputDirectory

    out = next((b for a, b in zip(argv, argv[1:], strict=False) if a == "--out"), None)  # noqa: RUF007
    out = out or next((text[6:] for text in argv if text.startswith("--out=")), None)
    if out is None and argv[0] == "run":
        with contextlib.suppress(WorkbenchError, SystemExit):
            out = default_out(parse(argv, COMMANDS).pipeline)
    try:
        folder = OutputDirectory(out).supersede() if out and argv[0] == "run" else None
    except WorkbenchError:
        return  # not writable: the error line says so
    if folder:
        with contextlib.suppress(OSError):
            print(one_line(f"note: the results of an earlier run were moved to {folder}"), file=sys.stderr)


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


SELDOM = 10_000  # objects between two looks for garbage: imports make many that stay


def program() -> NoReturn:
    """The command line as a process of its own. What lives to its end is not searched for garbage again and again."""
    gc.set_threshold(SELDOM)
    status = main()
    gc.freeze()
    sys.exit(status)


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    argv = sys.argv[1:] if argv is None else argv
    # Before numpy comes: its matrices are small here, where a second thread only waits (15 % of an inspection's time).
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
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
        if getattr(error, "supersedes", True):
            supersede(argv)
        return status
