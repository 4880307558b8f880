"""Errors that a user can mend. The command line prints each as one `error:` line and exits with 2."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST = 1200  # characters of a message


class WorkbenchError(Exception):
    """Something outside the program is unusable: `where` (file and place), then what was expected."""

    supersedes = True  # after a run that ended so, an earlier run's results must not stand for its own

    def __init__(self, where: str, expected: str) -> None:
        super().__init__(one_line(f"{where}: {expected}"))
        self.where = where
        self.expected = expected


class InputError(WorkbenchError):
    """A recording, calibration or other data file cannot be used."""


class PipelineError(WorkbenchError):
    """A pipeline document or its arguments cannot be used; `where` is a JSON path."""


class ArgumentError(PipelineError):
    """The command line or a call names what is not there: nothing has begun."""

    supersedes = False


class OutputError(WorkbenchError):
    """The output directory cannot be written."""


class StreamError(OutputError):
    """Standard output cannot be written; the results are where they belong."""

    supersedes = False


def nearest(name: str, known: Iterable[str]) -> str:
    """'; did you mean NAME?' for the closest known name, or the known names if none is close."""
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; known: {', '.join(names[:12])}" if names else ""


def one_line(text: str) -> str:
    """`text` with control characters escaped, so that a name out of a file cannot forge a second line.

    What is too long to read, such as a number of 5,000 digits out of a file, loses its middle.
    """
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"
