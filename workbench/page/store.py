"""What was asked for and what came of it, in a SQLite file: nothing that was acknowledged is lost by a kill."""

from __future__ import annotations

import json
import sqlite3
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from workbench.errors import InputError, OutputError

State = Literal["queued", "running", "done", "failed", "cancelled"]
VERSION = 1  # of the tables
TABLES = """
CREATE TABLE IF NOT EXISTS runs (
    id INTEGER PRIMARY KEY, kind TEXT NOT NULL, inputs TEXT NOT NULL, begun REAL NOT NULL, state TEXT NOT NULL,
    status INTEGER, part TEXT, verdict TEXT, reason TEXT, sizes TEXT, step TEXT
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

    @property
    def when(self) -> str:
        """When it was asked for, local time."""
        return time.strftime("%Y-%m-%d %H:%M", time.localtime(self.begun))


@dataclass(frozen=True)
class Preset:
    """A pipeline with inputs that were chosen once, under a name."""

    name: str
    pipeline: str
    inputs: dict[str, Any]


class Store:
    """The file, for any thread.

    Raises:
        OutputError: it cannot be made.
        InputError: it is no store, or one of another version.
    """

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        try:
            self._base = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
            self._base.row_factory = sqlite3.Row
            self._base.execute("PRAGMA journal_mode=WAL")
            self._base.execute("PRAGMA synchronous=FULL")
            (found,) = self._base.execute("PRAGMA user_version").fetchone()
            if found not in (0, VERSION):
                raise InputError(
                    str(path), f"expected a store of version {VERSION}, found {found}: a newer workbench's?"
                )
            self._base.executescript(TABLES)
            self._base.execute(f"PRAGMA user_version={VERSION}")
            # what a killed server left at work is done again
            self._base.execute("UPDATE runs SET state='queued', step=NULL WHERE state='running'")
        except sqlite3.OperationalError as error:
            raise OutputError(str(path), f"cannot be written: {error}") from None
        except sqlite3.DatabaseError:
            raise InputError(str(path), "expected the store of `workbench open`, which this is not") from None

    def add(self, kind: str, inputs: dict[str, Any]) -> int:
        """The number of a new run, which waits for its turn."""
        row = self._do(
            "INSERT INTO runs (kind, inputs, begun, state) VALUES (?, ?, ?, 'queued') RETURNING id",
            kind,
            json.dumps(inputs),
            time.time(),
        )
        return int(row[0]["id"])

    def update(self, number: int, **values: Any) -> None:
        """Change columns of a run."""
        if "sizes" in values:
            values["sizes"] = json.dumps(values["sizes"])
        columns = ", ".join(f"{name}=?" for name in values)
        self._do(f"UPDATE runs SET {columns} WHERE id=?", *values.values(), number)

    def next(self) -> Run | None:
        """The oldest run that waits."""
        return next(iter(self._runs("WHERE state='queued' ORDER BY id LIMIT 1")), None)

    def run(self, number: int) -> Run | None:
        """One run."""
        return next(iter(self._runs("WHERE id=?", number)), None)

    def runs(self, part: str = "", most: int = 200) -> list[Run]:
        """The last runs, newest first; of parts whose names contain `part`."""
        return self._runs(
            "WHERE kind<>'preview' AND instr(lower(coalesce(part, '')), lower(?)) ORDER BY id DESC LIMIT ?", part, most
        )

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
            Run(**{**dict(row), "inputs": json.loads(row["inputs"]), "sizes": json.loads(row["sizes"] or "{}")})
            for row in rows
        ]

    def _do(self, statement: str, *values: Any) -> list[sqlite3.Row]:
        with self._lock:
            return self._base.execute(statement, values).fetchall()
