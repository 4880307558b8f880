"""RAPID text as words, numbers and signs, with the line of each for messages."""

from __future__ import annotations

import re
from bisect import bisect_right
from typing import NoReturn

from workbench.errors import InputError

# White space and comments, then one token: a word, a number, a string, `:=`, else any one character; '' at the end.
TOKEN = re.compile(
    r"(?:[ \t\r\n]+|![^\n]*)*([A-Za-z][A-Za-z0-9_]*|[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
    r'|"[^"\\\n]*"|:=|.|\Z)',
    re.DOTALL,
)
LARGEST = 3.4e38  # RAPID's num has single precision
LONGEST_STRING = 80  # characters
SHOWN = 40


class Tokens:
    """The tokens of a program from first to last; every complaint names the line."""

    def __init__(self, text: str, name: str) -> None:
        """Split `text`; `name` is the file's, for messages."""
        self.text, self.name, self.at = text, name, 0
        matches = list(TOKEN.finditer(text))
        self.tokens: list[str] = [match.group(1) for match in matches]
        self._starts = [match.start(1) for match in matches]
        self._ends = [match.start() for match in re.finditer("\n", text)]

    def peek(self) -> str:
        """The next token as it stands; '' at the end."""
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def word(self, ahead: int = 0) -> str:
        """The next token, or one further ahead, in lower case: RAPID knows no other."""
        return self.tokens[self.at + ahead].lower() if self.at + ahead < len(self.tokens) else ""

    def take(self, *expected: str) -> str:
        """Step over one of `expected` (in lower case) and return it."""
        found = self.tokens[self.at].lower()
        if found not in expected:
            self.refuse(" or ".join(map(repr, expected)))
        self.at += 1
        return found

    def number(self) -> float:
        """Step over a number."""
        token = self.tokens[self.at]
        try:
            value = float(token) if token[-1:] in "0123456789." else None
        except ValueError:
            value = None
        if value is None or abs(value) > LARGEST:
            self.refuse("a number")
        self.at += 1
        return value

    def string(self) -> str:
        """Step over a string."""
        token = self.tokens[self.at]
        if len(token) < 2 or token[0] != '"' or len(token) > LONGEST_STRING + 2:
            self.refuse(f"a string of at most {LONGEST_STRING} characters")
        self.at += 1
        return token[1:-1]

    def refuse(self, expected: str, at: int | None = None) -> NoReturn:
        """Raise InputError: what was expected in place of the next token, or of the one at index `at`."""
        index = self.at if at is None else at
        found = self.tokens[index] if index < len(self.tokens) else ""
        shown = repr(found[:SHOWN]) if found else "the end of the file"
        raise InputError(self.name, f"line {self.line(index)}: expected {expected}, found {shown}")

    def line(self, index: int) -> int:
        """The line, from 1, in which a token begins."""
        at = self._starts[index] if index < len(self._starts) else len(self.text)
        return bisect_right(self._ends, at - 1) + 1
