"""A controller's language as a table of forms, by which programs are written and, strictly, read back.

A form is a format string of Python: `"L P[{target:d}] {feed:.1f}mm/sec {near}"`. It is written by `str.format`, and
read by the pattern that follows from it: a field with a format of numbers is a number, `{tool:d}` digits,
`{pose[0]:.4f}` an element of a list, any other a name, or what the table's `kinds` say. What may follow what is a table
too: the grammar of the languages' statements is a finite automaton. All else is refused, with its line and what was
expected there.
"""

from __future__ import annotations

import functools
import re
import string
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn

from workbench.errors import InputError

NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
NAME = "[A-Za-z][A-Za-z0-9_]*"
TOKEN = re.compile(rf"[A-Za-z$][A-Za-z0-9_]*|{NUMBER}|:=|\S|\Z")
LINE_END = r"[ \t]*(?:\r?\n|\Z)"
HIDDEN = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\x85\u2028\u2029]|\r(?!\n)")  # may end a line to a controller
EXTREME = re.compile(r"(?<![\w.])(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE]\+?0*[1-9][0-9]|[0-9]{39}")
SHOWN = 50  # characters of what is refused


class Said(NamedTuple):
    """One statement of a program."""

    form: str
    values: dict[str, Any]  # by field: a number, a text, or a list of either
    line: int  # of the file, from 1
    text: str


class _Piece(NamedTuple):
    """What stands in a form: words, or a field."""

    pattern: re.Pattern[str]
    words: str  # for messages
    field: str = ""  # its name; '': words
    many: bool = False  # it is an element of a list
    number: type | None = None


@dataclass(frozen=True)
class Language:
    """Forms of a language, and the order in which programs have them.

    Attributes:
        forms: name -> format string; a line break of it is one of the file.
        order: name of a form -> names of those that may follow; a form that is no key changes nothing. '': the begin
            as a key, the end as one that may follow; (): nothing else may.
        kinds: name of a field -> pattern, where it is no number and no name.
        comment: begins a remark, up to the end of the line; '': there are none.
    """

    forms: Mapping[str, str]
    order: Mapping[str, tuple[str, ...]]
    kinds: Mapping[str, str] = field(default_factory=dict)
    comment: str = ""

    def say(self, form: str, **values: Any) -> str:
        """A form with its fields."""
        return self.forms[form].format_map(values)

    def search(self, text: str) -> list[Said]:
        """What its forms say in other people's programs, wherever they stand, in the order of the text.

        Remarks, blanks and letters' case do not count.
        """
        code = re.sub(rf"{re.escape(self.comment)}[^\n]*", "", text) if self.comment else text
        found = []
        for form in self.forms:
            pieces = self._pieces(form, True)
            parts = (f"({piece.pattern.pattern})" if piece.field else piece.pattern.pattern for piece in pieces)
            fields = [piece for piece in pieces if piece.field]
            for match in re.finditer(r"\s*".join(parts), code, re.IGNORECASE):
                line = code.count("\n", 0, match.start()) + 1
                found.append((match.start(), Said(form, _values(fields, match.groups()), line, match[0])))
        return [said for _, said in sorted(found, key=lambda one: one[0])]

    @functools.cached_property
    def _compiled(self) -> dict[str, tuple[re.Pattern[str], list[_Piece]]]:
        """The pattern of each form, and its fields."""
        made = {}
        for form in self.forms:
            pieces = self._pieces(form)
            parts = (f"({piece.pattern.pattern})" if piece.field else piece.pattern.pattern for piece in pieces)
            made[form] = re.compile("".join(parts) + LINE_END), [piece for piece in pieces if piece.field]
        return made

    @functools.cached_property
    def _between(self) -> re.Pattern[str]:
        """Between two statements."""
        remark = rf"(?:{re.escape(self.comment)}[^\n]*)?" if self.comment else ""
        return re.compile(rf"(?:[ \t]*{remark}(?:\r?\n|\Z))*[ \t]*")

    def _pieces(self, form: str, by_word: bool = False) -> list[_Piece]:
        """What a form consists of, line by line or word by word."""
        pieces: list[_Piece] = []
        for words, name, spec, _ in string.Formatter().parse(self.forms[form].lstrip(" ")):
            parts = TOKEN.findall(words) if by_word else re.split(r"(\n)[ \t]*", words)
            pieces += [self._words(one, by_word) for one in parts if one]
            if name is not None:
                pieces.append(self._field(name, spec or ""))
        return pieces

    def _words(self, words: str, by_word: bool) -> _Piece:
        if words == "\n":
            return _Piece(re.compile(r"[ \t]*\r?\n[ \t]*"), "the end of the line")
        bound = r"\b" if by_word and words[-1].isalnum() else ""
        return _Piece(re.compile(re.escape(words) + bound), repr(words))

    def _field(self, name: str, spec: str) -> _Piece:
        plain, many, _ = name.partition("[")
        kinds: dict[str, type] = {"d": int, "f": float, "g": float}
        number = kinds.get(spec[-1:])
        digits = f"[0-9]{{{int(spec[:-1])}}}" if spec.startswith("0") else "[0-9]+"
        usual = NAME if number is None else digits if number is int else NUMBER
        words = plain.replace("_", " ").strip() if plain in self.kinds else "a number" if number else "a name"
        pattern = re.compile(self.kinds.get(plain, usual))
        return _Piece(pattern, words, plain, bool(many), number)

    def read(self, text: str, name: str) -> Iterator[Said]:
        """The statements of a text from first to last.

        Raises:
            InputError: "line 12: expected ..., found ...".
        """
        at, line, allowed = 0, 1, self.order[""]
        if hidden := HIDDEN.search(text):
            refuse(name, text.count("\n", 0, hidden.start()) + 1, "no control characters", hidden[0])
        while True:
            skipped = self._between.match(text, at)
            begin = skipped.end() if skipped else at
            line += text.count("\n", at, begin)
            if begin == len(text) and (not allowed or "" in allowed):
                return
            said = self._one(text, begin, line, allowed) or self._refuse(text, begin, name, allowed)
            if EXTREME.search(said.text):
                refuse(name, line, "numbers that single precision holds", said.text.strip())
            yield said
            at = begin + len(said.text)
            line += said.text.count("\n")
            allowed = self.order.get(said.form, allowed)

    def _one(self, text: str, at: int, line: int, allowed: tuple[str, ...]) -> Said | None:
        """The statement that begins here, if it is one of those allowed."""
        for form in filter(None, allowed):
            pattern, fields = self._compiled[form]
            if found := pattern.match(text, at):
                return Said(form, _values(fields, found.groups()), line, found[0])
        return None

    def _refuse(self, text: str, at: int, name: str, allowed: tuple[str, ...]) -> NoReturn:
        """Say how far any of those allowed was there, and what it wanted next."""
        reached = [self._reach(text, at, form) for form in allowed if form]
        farthest = max((place for place, _ in reached), default=at)
        wanted = dict.fromkeys(words for place, words in reached if place == farthest)
        expected = " or ".join(wanted) or "the end of the file"
        refuse(name, text.count("\n", 0, farthest) + 1, expected, text[farthest:].partition("\n")[0].strip())

    def _reach(self, text: str, at: int, form: str) -> tuple[int, str]:
        """As far as a form is there, and what it wants next."""
        for piece in (*self._pieces(form), _END):
            found = piece.pattern.match(text, at)
            if found is None:
                return at, piece.words
            at = found.end()
        return at, ""


_END = _Piece(re.compile(LINE_END), "the end of the line")


def _values(fields: list[_Piece], groups: tuple[str, ...]) -> dict[str, Any]:
    """By field: a number, a text, or a list of either."""
    made: dict[str, Any] = {}
    for piece, text in zip(fields, groups, strict=True):
        value = piece.number(text) if piece.number else text
        if piece.many:
            made.setdefault(piece.field, []).append(value)
        else:
            made[piece.field] = value
    return made


def reading(form: str) -> str:
    """The pattern of a form, without groups: to be a field's kind."""
    return "".join(f"(?:{piece.pattern.pattern})" for piece in Language({"": form}, {})._pieces(""))


def row(names: Iterable[str], field: str, spec: str, between: str = ",") -> str:
    """Of a form: the elements of a list, each behind its name."""
    return between.join(f"{name}{{{field}[{i}]:{spec}}}" for i, name in enumerate(names))


def refuse(name: str, line: int, expected: str, found: str) -> NoReturn:
    """Raise InputError for a line of a file."""
    shown = repr(found[:SHOWN]) if found else "the end of the file"
    raise InputError(name, f"line {line}: expected {expected}, found {shown}")
