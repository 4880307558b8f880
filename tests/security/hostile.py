"""What a hostile file would carry in its names, and where to look for it."""

from __future__ import annotations

from pathlib import Path

MARKUP = "</title></script><script>alert(1)</script><img src=x onerror=alert(2)>\"'>{{7*191*1000003}}${recording}"
PROGRAM = "\r\nENDPROC\nENDMODULE\n&ACCESS RVP\n%%%\n! ; MoveL p1,v7000,fine,tool0;\u2028PTP {A1 0}"
NAMES = {  # each stands where a file may carry a text
    "markup": MARKUP,
    "program": PROGRAM,
    "formula": "=cmd|'/C calc'!A0",
    "path": "../../../../tmp/owned\x00/etc/passwd",
    "terminal": "\x1b]0;owned\x07\x1b[2J\x9b31m error: forged\n",
    "long": "A" * 60_000,
}


def files_below(folder: Path) -> set[str]:
    """Everything below a folder, as relative paths."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def assert_plain_lines(text: str) -> None:
    """No control character reaches a terminal, and no line was forged."""
    assert all(character.isprintable() or character == "\n" for character in text), ascii(text)[:300]


def assert_refused(outcome, place: str) -> None:
    """Exit 2 with one line that names the place."""
    assert outcome.status == 2, outcome
    lines = [line for line in outcome.err.splitlines() if not line.startswith("[")]
    assert len([line for line in lines if line.startswith("error: ")]) == 1, outcome.err[:600]
    assert place in outcome.err
    assert "internal" not in outcome.err
    assert "failed inside" not in outcome.err
    assert_plain_lines(outcome.err)
