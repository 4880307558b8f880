"""What was asked for and what came of it, in a SQLite file: nothing that was acknowledged is lost by a kill."""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from workbench.errors import InputError, OutputError

State = Literal["queued", "running", "done", "failed", "cancelled"]
VERSION = 2  # of the tables; 1 had no records
FILTERS = ("cell", "sensor", "tool")  # of a record
TABLES = """
CREATE TABLE IF NOT EXISTS runs (
    id INTEGER PRIMARY KEY, kind TEXT NOT NULL, inputs TEXT NOT NULL, begun REAL NOT NULL, state TEXT NOT NULL,
    status INTEGER, part TEXT, verdict TEXT, reason TEXT, sizes TEXT, step TEXT, record TEXT
);
CREATE TABLE IF NOT EXISTS presets (name TEXT PRIMARY KEY, pipeline TEXT NOT NULL, inputs TEXT NOT NULL);
"""


@dataclass(frozen=True)
class Run:
    """One run of a pipeline, or one look at a file (`kind` is then "look")."""

    id: int
    kind: str
    inputs: dict[str, Any]
    begun: float  # s since 1970
    state: State
    status: int | None  # exit status of the command
    part: str | None
    verdict: str | None
    reason: str | None  # of the verdict, or what was wrong
    sizes: dict[str, list[float]]  # characteristic: mean over the sections, largest U
    step: str | None  # of a run at work: [k/n] stage
    record: dict[
        str, Any
    ]  # of an inspection: identity, requirements, sections, cell, sensor, tool; where its files lie

    @property
    def when(self) -> str:
        """When it was asked for, local time."""
        return time.strftime("%Y-%m-%d %H:%M", time.localtime(self.begun))

    @property
    def about(self) -> str:
        """Its part, or the file that it began with."""
        return self.part or Path(str(self.inputs.get("file") or self.inputs.get("recording") or "")).name


@dataclass(frozen=True)
class Preset:
    """A pipeline with inputs that were chosen once, under a name."""

    name: str
    pipeline: str
    inputs: dict[str, Any]


class Store:
    """The file, for any thread. Whatever is asked of it raises OutputError where the disk is full or fails.

    Raises:
        OutputError: it cannot be made.
        InputError: it is no store, or one of another version.
    """

    def __init__(self, path: Path) -> None:
        self._lock, self._path = threading.Lock(), path
        try:
            self._base = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
            self._base.row_factory = sqlite3.Row
            self._base.execute("PRAGMA journal_mode=WAL")
            self._base.execute("PRAGMA synchronous=FULL")
            (found,) = self._base.execute("PRAGMA user_version").fetchone()
            if not 0 <= found <= VERSION:
                raise InputError(
                    str(path), f"expected a store of version {VERSION}, found {found}: a newer workbench's?"
                )
            self._base.executescript(TABLES)
            if found == 1:
                self._base.execute("ALTER TABLE runs ADD COLUMN record TEXT")
            self._base.execute(f"PRAGMA user_version={VERSION}")
        except sqlite3.OperationalError as error:
            raise OutputError(str(path), f"cannot be written: {error}") from None
        except sqlite3.DatabaseError:
            raise InputError(str(path), "expected the store of `workbench open`, which this is not") from None

    @classmethod
    def of(cls, folder: Path) -> Store:
        """That of a folder of `workbench open`.

        Raises:
            InputError, OutputError: not a folder; as Store.
        """
        if not folder.is_dir():
            raise InputError(str(folder), "expected a folder with recordings (workbench samples DIR makes one to try)")
        try:
            (folder / ".workbench").mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(str(folder), f"cannot be written: {error.strerror}") from None
        return cls(folder / ".workbench" / "store.sqlite")

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def resume(self) -> None:
        """What a killed server left at work waits again. For a server alone: others may be at work."""
        self._do("UPDATE runs SET state='queued', step=NULL WHERE state='running'")

    def add(self, kind: str, inputs: dict[str, Any], state: State = "queued", **values: Any) -> int:
        """The number of a new run: one that waits for its turn, or that was made elsewhere, with its columns.

        It is there as a whole or not at all.
        """
        columns = {"kind": kind, "inputs": inputs, "begun": time.time(), "state": state, **values}
        row = self._do(
            f"INSERT INTO runs ({', '.join(columns)}) VALUES ({', '.join('?' * len(columns))}) RETURNING id",
            *map(_column, columns.values()),
        )
        return int(row[0]["id"])

    def update(self, number: int, **values: Any) -> None:
        """Change columns of a run."""
        columns = ", ".join(f"{name}=?" for name in values)
        self._do(f"UPDATE runs SET {columns} WHERE id=?", *map(_column, values.values()), number)

    def next(self) -> Run | None:
        """The oldest run that waits."""
        return next(iter(self._runs("WHERE state='queued' ORDER BY id LIMIT 1")), None)

    def run(self, number: int) -> Run | None:
        """One run."""
        return next(iter(self._runs("WHERE id=?", number)), None)

    def runs(self, of: Mapping[str, str] | None = None, most: int = 200) -> list[Run]:
        """The last runs, newest first. `of`: a piece of the part's name, and the `cell`, `sensor`, `tool`; '': any."""
        of = of or {}
        also = "".join(f" AND json_extract(record, '$.{name}')=?" for name in FILTERS if of.get(name))
        return self._runs(
            f"WHERE kind<>'preview' AND instr(lower(coalesce(part, '')), lower(?)){also} ORDER BY id DESC LIMIT ?",
            of.get("part", ""),
            *(of[name] for name in FILTERS if of.get(name)),
            most,
        )

    def known(self, name: str) -> list[str]:
        """What runs say of one of FILTERS."""
        rows = self._do(f"SELECT DISTINCT json_extract(record, '$.{name}') AS one FROM runs")
        return sorted(str(row["one"]) for row in rows if row["one"])

    def has(self, record: dict[str, Any]) -> bool:
        """Whether a run has that record."""
        return bool(self._do("SELECT 1 FROM runs WHERE record=? LIMIT 1", json.dumps(record)))

    def keep(self, preset: Preset) -> None:
        """Keep a preset, in the place of one of that name."""
        self._do("REPLACE INTO presets VALUES (?, ?, ?)", preset.name, preset.pipeline, json.dumps(preset.inputs))

    def presets(self) -> list[Preset]:
        """All presets by name."""
        rows = self._do("SELECT * FROM presets ORDER BY name")
        return [Preset(row["name"], row["pipeline"], json.loads(row["inputs"])) for row in rows]

    def close(self) -> None:
        """Let go of the file."""
        with self._lock:
            self._base.close()

    def _runs(self, rest: str, *values: Any) -> list[Run]:
        rows = self._do(f"SELECT * FROM runs {rest}", *values)
        return [
            Run(**{**dict(row), **{name: json.loads(row[name] or "{}") for name in ("inputs", "sizes", "record")}})
            for row in rows
        ]

    def _do(self, statement: str, *values: Any) -> list[sqlite3.Row]:
        try:
            with self._lock:
                return self._base.execute(statement, values).fetchall()
        except sqlite3.DatabaseError as error:
            raise OutputError(str(self._path), f"cannot be read or written: {error}") from None


def _column(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, dict) else value
