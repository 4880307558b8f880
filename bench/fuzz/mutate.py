"""Mutations of files: of bytes, of the cells of a table, of the nodes of a JSON document."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from typing import Any

TOKENS = (
    b"nan",
    b"NaN",
    b"inf",
    b"-Infinity",
    b"1e999",
    b"-0",
    b"0",
    b"1e-320",
    b"99999999999999999999",
    b"-1",
    b"0x1F",
    b"1_000",
    b"null",
    b"true",
    b"",
    b" ",
    b"\t",
    b"\n",
    b"\r",
    b"\x00",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b'"',
    b"'",
    b",",
    b";",
    b"#",
    b"{",
    b"]",
    b"[" * 3000,
    b"9" * 5000,
    b"../../x",
    b"/dev/zero",
    b"${x}",
    b"<script>",
    b"%s%n",
    "µ°ß".encode(),
    b"\\u0000",
    b"\\ud800",
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    1e308,
    -1e308,
    1e-320,
    10**30,
    10**400,
    0.5,
    "",
    "x",
    "nan",
    "../x",
    "\x00",
    "<b>",
    [],
    {},
    [[]],
    {"x": 1},
    [1, 2, 3],
    [None],
    ["a"] * 40,
    "9" * 400,
    float("nan"),
    float("inf"),
)


def mutated(content: bytes, suffix: str, rng: random.Random) -> bytes:
    """A file like `content`, changed in one to four places; by its kind where it has one."""
    by_kind = {".json": json_node, ".csv": table_cell, ".txt": table_cell}.get(suffix)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        change = by_kind if by_kind and rng.random() < 0.6 else rng.choice(BYTES)
        content = change(content, rng)
    return content


def flip(content: bytes, rng: random.Random) -> bytes:
    """One bit of one byte."""
    changed = bytearray(content)
    if changed:
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def overwrite(content: bytes, rng: random.Random) -> bytes:
    """A few bytes by others, often the extremes of a number."""
    i, n = rng.randrange(len(content) + 1), rng.choice((1, 2, 4, 8))
    fill = rng.choice((b"\x00" * n, b"\xff" * n, b"\x7f" + b"\xff" * (n - 1), rng.randbytes(n)))
    return content[:i] + fill + content[i + n :]


def cut(content: bytes, rng: random.Random) -> bytes:
    """The end, or a piece of the middle, is missing."""
    i = rng.randrange(len(content) + 1)
    return content[:i] if rng.random() < 0.5 else content[:i] + content[i + rng.randrange(1, 200) :]


def repeat(content: bytes, rng: random.Random) -> bytes:
    """A piece stands there twice, or many times."""
    i = rng.randrange(len(content) + 1)
    piece = content[i : i + rng.randrange(1, 200)]
    return content[:i] + piece * rng.choice((2, 2, 3, 50)) + content[i + len(piece) :]


def insert(content: bytes, rng: random.Random) -> bytes:
    """A token that readers are known to stumble over."""
    i = rng.randrange(len(content) + 1)
    return content[:i] + rng.choice(TOKENS) + content[i + rng.choice((0, 0, 1, 3)) :]


def move(content: bytes, rng: random.Random) -> bytes:
    """Two pieces change places."""
    i, j = sorted((rng.randrange(len(content) + 1), rng.randrange(len(content) + 1)))
    n = rng.randrange(1, 40)
    return content[:i] + content[j : j + n] + content[i + n : j] + content[i : i + n] + content[j + n :]


def table_cell(content: bytes, rng: random.Random) -> bytes:
    """One cell of one line by a token, by its neighbour, or gone; or a line gone or twice."""
    lines = content.split(b"\n")
    k = rng.randrange(len(lines)) if rng.random() < 0.6 else rng.randrange(min(3, len(lines)))  # headers matter
    delimiter = max((b",", b";", b"\t", b" "), key=lines[k].count)
    row = lines[k].split(delimiter)
    c, action = rng.randrange(len(row)), rng.random()
    if action < 0.6:
        row[c] = rng.choice(TOKENS)
    elif action < 0.75:
        row[c] = row[rng.randrange(len(row))]
    elif action < 0.9:
        del row[c]
    lines[k : k + 1] = [delimiter.join(row)] * (1 if action < 0.9 else rng.choice((0, 2)))
    return b"\n".join(lines)


def json_node(content: bytes, rng: random.Random) -> bytes:
    """One node of a document by another value, gone, under another name, or twice as deep."""
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError):
        return flip(content, rng)
    places = list(_places(tree))
    if not places:
        return json.dumps(rng.choice(VALUES)).encode()
    parent, key = rng.choice(places)
    action = rng.random()
    if action < 0.7:
        parent[key] = rng.choice(VALUES)
    elif action < 0.8:
        del parent[key]
    elif action < 0.9 and isinstance(parent, dict):
        parent[rng.choice((key + "s", key[:-1], key.upper(), "x"))] = parent.pop(key)
    elif isinstance(parent, list):
        parent.insert(key, parent[rng.randrange(len(parent))])
    else:
        parent[key] = [parent[key]]
    return json.dumps(tree).encode()


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """(container, key) of every node below the top."""
    found: list[tuple[Any, Any]] = []
    left = [tree]
    while left:
        node = left.pop()
        keys = node.keys() if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
        found += [(node, key) for key in keys]
        left += [node[key] for key in keys]
    return found


BYTES: tuple[Callable[[bytes, random.Random], bytes], ...] = (flip, overwrite, cut, repeat, insert, move)
