"""The workbench's page: recordings, runs and results of one folder, for this machine's user alone.

Every page is made here as HTML; a script of a few lines sends what is chosen and asks how a run goes on. What a stage
says of its parameters is what a form says of its fields.
"""

from __future__ import annotations

import asyncio
import functools
import json
import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

import jinja2
from markupsafe import Markup
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route

from workbench import samples
from workbench.errors import InputError, OutputError, WorkbenchError
from workbench.page.drafts import answered, questions
from workbench.page.forms import fields_of, label
from workbench.page.jobs import DRAFT, IMPORT, LOOK, PREVIEW, Queue
from workbench.page.records import alike, fleet
from workbench.page.store import FILTERS, Preset, Run, Store
from workbench.pipeline.catalogue import unit_of
from workbench.pipeline.follow import state_of
from workbench.report.html_stage import script_source, viewer_script
from workbench.server import LocalServer
from workbench.storage import partial_path
from workbench.view import NotServedError, Results, serve_at, within

HERE = Path(__file__).parent
REPORT = "report.html"
MOST_CHARTED = 2000  # parts
MOST_BYTES = 8_000_000_000  # of an upload
RECORDINGS = (".h5", ".hdf5")
READ = (
    *RECORDINGS,
    *(".csv", ".txt", ".asc", ".npz", ".dat", ".yml"),
    *(".ply", ".pcd", ".las", ".laz", ".e57", ".xyz", ".step", ".stp", ".dxf"),
    *(".ls", ".mod", ".src", ".jbi", ".script", ".json", ".urdf", ".xml"),
)
NAME = re.compile(r"[^/\\:\0\x00-\x1f.][^/\\:\0\x00-\x1f]{0,199}")
ASKED = (  # for most; they stand first
    "inspect_bevel",
    "inspect_preparation",
    "inspect_groove",
    "inspect_cloud",
    "plan_bevel",
    "plan_cloud",
    "calibrate_handeye",
    "optimise_posture",
    "compare_scans",
)


class Page:
    """One folder with its store and its queue, as an ASGI application.

    Args:
        folder: the user's; results go to `results/`, what the page remembers to `.workbench/`.

    Raises:
        InputError, OutputError: not a folder, or one that cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.resolve()
        self.store = Store.of(folder)
        try:
            (self.folder / "results").mkdir(exist_ok=True)
        except OSError as error:
            raise OutputError(str(folder), f"cannot be written: {error.strerror}") from None
        self._results = Results(self.folder / "results", may_be_empty=True)
        self.queue = Queue(self.store, self.folder)
        self.words = json.loads((HERE / "english.json").read_text(encoding="utf-8"))
        self.templates = jinja2.Environment(
            loader=jinja2.FileSystemLoader(HERE / "templates"), autoescape=True, undefined=jinja2.StrictUndefined
        )
        self.script = (HERE / "page.js").read_text(encoding="utf-8")
        self.templates.globals |= {
            "t": self.words,
            "style": (HERE / "page.css").read_text(encoding="utf-8"),
            "script": self.script,
            "label": label,
            "unit_of": unit_of,
            "quote": quote,
            "sketch": sketch,
            "moved": moved,
        }
        routes = [
            Route("/", self._answer(self.shop)),
            Route("/new", self._answer(self.form)),
            Route("/runs/{number:int}", self._answer(self.run)),
            Route("/operator", self._answer(self.operator)),
            Route("/api/runs", self._answer(self.ask), methods=["POST"]),
            Route("/api/runs/{number:int}", self._answer(self.state)),
            Route("/api/runs/{number:int}/cancel", self._answer(self.cancel), methods=["POST"]),
            Route("/api/presets", self._answer(self.keep), methods=["POST"]),
            Route("/api/next", self._answer(self.newest)),
            Route("/api/files/{name}", self.upload, methods=["PUT"]),
            Route("/runs/{number:int}/part.json", self._answer(self.run)),  # where the charts' rows lead
            Route("/runs/charts", self._answer(self.charts)),
            Route("/runs/parts.parquet", self._answer(self.table)),
            Mount("/results", self.results),
        ]
        self.app = Starlette(routes=routes)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """One request."""
        await self.app(scope, receive, send)

    async def results(self, scope: Any, receive: Any, send: Any) -> None:
        """A file of a run."""
        await self._results({**scope, "raw_path": scope["raw_path"].removeprefix(b"/results")}, receive, send)

    def close(self) -> None:
        """End what is at work; it begins again with the next start."""
        self.queue.close()
        self.store.close()

    def _answer(self, make: Callable[[Request, Any], Response]) -> Callable[[Request], Any]:
        """A handler off the loop; what a user did wrong is one line.

        Who asks for the same before work on it has begun gets the same answer: so a crowd delays nobody.
        """

        at_work = asyncio.Lock()
        waiting: dict[str, asyncio.Task[Response]] = {}

        async def once(request: Request, key: str) -> Response:
            async with at_work:
                waiting.pop(key)
                return await asyncio.to_thread(make, request, None)

        @functools.wraps(make)
        async def handle(request: Request) -> Response:
            try:
                if request.method == "POST":
                    return await asyncio.to_thread(make, request, json.loads(await request.body() or b"null"))
                key = str(request.url)
                if key not in waiting:
                    waiting[key] = asyncio.create_task(once(request, key))
                return await asyncio.shield(waiting[key])
            except WorkbenchError as error:
                return JSONResponse({"error": str(error)}, HTTPStatus.BAD_REQUEST)
            except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError, AttributeError) as error:
                return JSONResponse({"error": f"not understood: {error!r}"}, HTTPStatus.BAD_REQUEST)

        return handle

    def _html(self, name: str, request: Request, **values: Any) -> Response:
        root = request.scope["root_path"]
        return HTMLResponse(self.templates.get_template(name).render(root=root, folder=self.folder.name, **values))

    def files(self) -> list[str]:
        """Names of what may be read in the folder, the newest first."""
        found = [path for path in self.folder.iterdir() if path.suffix.lower() in READ and path.is_file()]
        return [path.name for path in sorted(found, key=lambda path: -path.stat().st_mtime)]

    def pipelines(self) -> list[str]:
        """Pipelines that come with the project by name, those asked for most first; then the folder's own files."""
        shipped = sorted(
            samples.pipelines(), key=lambda name: (ASKED.index(name) if name in ASKED else len(ASKED), name)
        )
        own = sorted(path.name for path in self.folder.glob("*.json") if _is_pipeline(path))
        return [*shipped, *own]

    def pipeline(self, name: str) -> Path:
        """The file of a pipeline of that list."""
        if name not in self.pipelines():
            raise InputError("pipeline", f"expected one of {', '.join(self.pipelines())}; found {name!r}")
        return self.folder / name if name.endswith(".json") else Path(samples.shipped_pipeline(name))

    def shop(self, request: Request, body: Any) -> Response:
        """The last runs, and what can be begun."""
        of = self._filter(request)
        runs = self.store.runs(of)
        return self._html(
            "shop.html.j2",
            request,
            runs=runs,
            of=of,
            query=urlencode(of),
            known={name: self.store.known(name) for name in FILTERS},
            charted=len(alike(runs)),
            files=self.files(),
            presets=[one for one in self.store.presets() if one.pipeline != IMPORT],
            cells=[one.name for one in self.store.presets() if one.pipeline == IMPORT],
            pipelines=self.pipelines(),
            trends=trends(runs),
        )

    def _filter(self, request: Request) -> dict[str, str]:
        return {name: request.query_params.get(name, "") for name in ("part", *FILTERS)}

    def _parts(self, request: Request) -> tuple[str, list[Any]]:
        """The runs that share a chart, and what they are."""
        of = self._filter(request)
        runs = alike(self.store.runs(of, MOST_CHARTED))
        if not runs:
            raise InputError("parts", "there is no inspection yet that this filter lets through")
        said = ", ".join(f"{name} {value}" for name, value in of.items() if value)
        return f"{label(runs[-1].kind)}{': ' if said else ''}{said}", fleet(runs)

    def charts(self, request: Request, body: Any) -> Response:
        """Control charts and capability of each characteristic and section: the page of a fleet."""
        from workbench.batch.fleet import page

        title, records = self._parts(request)
        return HTMLResponse(page(records, title))

    def table(self, request: Request, body: Any) -> Response:
        """The same parts, section by section, as Parquet."""
        from workbench.batch.fleet import parquet

        _, records = self._parts(request)
        headers = {"Content-Disposition": "attachment; filename=parts.parquet"}
        return Response(parquet(records), headers=headers, media_type="application/octet-stream")

    def form(self, request: Request, body: Any) -> Response:
        """The inputs of a pipeline, as a preset, an earlier run or the pipeline itself has them."""
        name, values = request.query_params.get("pipeline", ""), {}
        if preset := self._preset(request.query_params.get("preset")):
            name, values = preset.pipeline, dict(preset.inputs)
        if again := self.store.run(int(request.query_params.get("again") or 0)):
            name, values = again.kind, dict(again.inputs)
        path = self.pipeline(name)
        title, fields = fields_of(path)
        if file := request.query_params.get("file"):
            first = next((one.name for one in fields if one.kind == "file"), "")
            values[first] = file
        return self._html(
            "form.html.j2", request, pipeline=name, title=title, fields=fields, values=values, files=self.files()
        )

    def run(self, request: Request, body: Any) -> Response:
        """One run: how it goes on, then its verdict, sizes and files."""
        run = self._found(request)
        folder = self.queue.results(run.id)
        if run.kind == DRAFT and run.state == "done":
            return self._draft(request, run)
        files = sorted(path.name for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
        earlier = [one for one in self.store.runs({"part": run.part or ""}) if one.kind == run.kind and one.id < run.id]
        changed = differences(earlier[0].inputs, run.inputs) if earlier and run.part else []
        in_space = REPORT in files and b'id="view"' in (folder / REPORT).read_bytes()
        context = {"files": files, "changed": changed, "in_space": in_space, "looks": (LOOK, IMPORT)}
        return self._html("run.html.j2", request, run=run, **context)

    def _draft(self, request: Request, run: Run) -> Response:
        """What was understood of other people's files: a question for each doubt."""
        mapping = json.loads((self.queue.results(run.id) / "mapping.json").read_text(encoding="utf-8"))
        if preset := self._preset(run.inputs.get("preset")):
            mapping = answered(mapping, preset.inputs)
        asked, name = questions(mapping), Path(run.inputs["files"][0]).with_suffix(".h5").name
        return self._html("draft.html.j2", request, run=run, mapping=mapping, questions=asked, made=name)

    def operator(self, request: Request, body: Any) -> Response:
        """One button, one answer."""
        preset = self._preset(request.query_params.get("preset"))
        if preset is None or preset.pipeline == IMPORT:
            raise InputError("preset", "expected the name of a preset: save one from a form first")
        _, fields = fields_of(self.pipeline(preset.pipeline))
        file = next((field.name for field in fields if field.kind == "file"), None)
        data = {**asdict(preset), "file": file, "states": self.words["states"], "todo": self.words["todo"]}
        return self._html("operator.html.j2", request, preset=preset, data=data)

    def ask(self, request: Request, body: Any) -> Response:
        """Begin a run of a pipeline, or a look at a file: {"pipeline", "inputs"} or {"look"}."""
        if file := body.get("look"):
            return JSONResponse({"id": self.queue.add(LOOK, {"file": str(self._file(file))})})
        if "draft" in body:
            return JSONResponse({"id": self._ask_import(body)})
        name, given = body["pipeline"], dict(body["inputs"])
        _, fields = fields_of(self.pipeline(name))
        known = {field.name: field for field in fields}
        for key, value in given.items():
            if key not in known:
                raise InputError(f"inputs.{key}", f"the pipeline {name} has no such input")
            if known[key].kind == "file" and value is not None and value != known[key].default:
                given[key] = str(self._file(value))
        kept = {key: value for key, value in given.items() if value != known[key].default}
        return JSONResponse({"id": self.queue.add(str(self.pipeline(name)) if name.endswith(".json") else name, kept)})

    def _ask_import(self, body: dict[str, Any]) -> int:
        """{"draft": files, "preset"}: what they are; {"draft": its number, "mapping", "made"}: the recording of them.

        Without "made" that is only looked at.
        """
        if isinstance(body["draft"], list):
            files = [str(self._file(name)) for name in body["draft"]]
            if not files:
                raise InputError("draft", "expected at least one file: tick those of one scan")
            return self.queue.add(DRAFT, {"files": files, "preset": body.get("preset")})
        draft, made = self.store.run(body["draft"]), body.get("made")
        if draft is None or draft.kind != DRAFT:
            raise InputError("draft", f"there is no draft {body['draft']}")
        if made is not None and (not NAME.fullmatch(made) or not made.endswith(".h5")):
            raise InputError("made", "expected the name of a recording, ending in .h5")
        target = unused(self.folder / made).name if made else ".workbench/preview.h5"
        more = {"mapping": dict(body["mapping"]), "made": target, "draft": draft.id}
        return self.queue.add(IMPORT if made else PREVIEW, {"files": draft.inputs["files"], **more})

    def state(self, request: Request, body: Any) -> Response:
        """A run as JSON."""
        run = self._found(request)
        return JSONResponse({**asdict(run), "todo": run.record.get("todo")})

    def cancel(self, request: Request, body: Any) -> Response:
        """End a run."""
        self.queue.cancel(self._found(request).id)
        return JSONResponse(asdict(self._found(request)))

    def keep(self, request: Request, body: Any) -> Response:
        """Save a preset: {"name", "pipeline", "inputs"}."""
        name = body["name"].strip()
        if not NAME.fullmatch(name):
            raise InputError(
                "name", "expected a name of 1 to 200 characters without / \\ : and not beginning with a dot"
            )
        if body["pipeline"] != IMPORT:
            self.pipeline(body["pipeline"])
        self.store.keep(Preset(name, body["pipeline"], dict(body["inputs"])))
        return JSONResponse({"name": name})

    def newest(self, request: Request, body: Any) -> Response:
        """What an operator waits for: the newest recording, when it was last written, whether it grows."""
        found = [path for path in self.folder.iterdir() if path.suffix.lower() in RECORDINGS and path.is_file()]
        path = max(found, key=lambda one: one.stat().st_mtime, default=None)
        if path is None:
            return JSONResponse({"file": None})
        grows = state_of(path) in ("growing", "locked")
        return JSONResponse({"file": path.name, "written": path.stat().st_mtime, "grows": grows})

    async def upload(self, request: Request) -> Response:
        """Store the body as a file of the folder: whole or not at all, and never in the place of another."""
        name = request.path_params["name"]
        if not NAME.fullmatch(name) or Path(name).suffix.lower() not in READ:
            return _wrong(
                f"{name}: expected a recording, a cloud or another file that workbench reads ({', '.join(READ)})"
            )
        target = unused(self.folder / name)
        partial = partial_path(target)
        try:
            size = 0
            with partial.open("xb") as file:
                async for piece in request.stream():
                    size += len(piece)
                    if size > MOST_BYTES:
                        return _wrong(f"{name}: larger than {MOST_BYTES / 1e9:g} GB")
                    await asyncio.to_thread(file.write, piece)
                await asyncio.to_thread(os.fsync, file.fileno())
            if not size:
                return _wrong(f"{name}: is empty")
            partial.rename(target)
        except OSError as error:
            return _wrong(f"{name}: cannot be written: {error.strerror}", HTTPStatus.INSUFFICIENT_STORAGE)
        finally:
            partial.unlink(missing_ok=True)
        return JSONResponse({"file": target.name})

    def _preset(self, name: str | None) -> Preset | None:
        return next((one for one in self.store.presets() if one.name == name), None)

    def _found(self, request: Request) -> Run:
        run = self.store.run(request.path_params["number"])
        if run is None:
            raise InputError("run", f"there is no run {request.path_params['number']}")
        if run.state in ("queued", "running") and self.queue.trouble:
            return replace(run, step=self.queue.trouble)
        return run

    def _file(self, name: str) -> Path:
        """A file inside the folder."""
        try:
            path = self.folder / name if not Path(name).is_absolute() else Path(name)
            return within(self.folder, quote(path.relative_to(self.folder).as_posix()))
        except (NotServedError, ValueError):
            raise InputError(name, f"expected a file in {self.folder}; is it still there?") from None


def _wrong(text: str, status: HTTPStatus = HTTPStatus.BAD_REQUEST) -> Response:
    return JSONResponse({"error": text}, status)


def _is_pipeline(path: Path) -> bool:
    """Whether a JSON file has stages, which no result has."""
    try:
        return path.stat().st_size < 1_000_000 and '"stages"' in path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False


def unused(path: Path) -> Path:
    """`path`, or the first of NAME-2, NAME-3, ... that is not there."""
    number = 1
    while path.exists():
        number += 1
        stem = path.stem if number == 2 else path.stem.rpartition("-")[0]
        path = path.with_name(f"{stem}-{number}{path.suffix}")
    return path


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
    """Inputs that changed from one run to the next: name, before, after."""
    names = dict.fromkeys([*before, *after])
    return [(name, before.get(name), after.get(name)) for name in names if before.get(name) != after.get(name)]


def trends(runs: list[Run]) -> dict[str, dict[str, list[tuple[Run, float, float]]]]:
    """Sizes of the runs by pipeline and characteristic, oldest first: run, mean, U; of those that have several."""
    found: dict[str, dict[str, list[tuple[Run, float, float]]]] = {}
    for run in reversed(runs):
        for name, (value, u) in run.sizes.items():
            found.setdefault(run.kind, {}).setdefault(name, []).append((run, value, u))
    several = {kind: {name: rows for name, rows in each.items() if len(rows) > 1} for kind, each in found.items()}
    return {kind: each for kind, each in several.items() if each}


def moved(rows: list[tuple[Run, float, float]]) -> bool:
    """Whether the last value differs from the first by more than both their U allow."""
    (_, first, u_first), (_, last, u_last) = rows[0], rows[-1]
    return abs(last - first) > math.hypot(u_first, u_last) > 0


def sketch(rows: list[tuple[Run, float, float]]) -> Markup:
    """Values in their order as a line, with the band of their U."""
    low, high = min(v - u for _, v, u in rows), max(v + u for _, v, u in rows)
    step, scale = 100.0 / (len(rows) - 1), 100.0 / max(high - low, 1e-12)
    points = [(k * step, (high - v) * scale, u * scale) for k, (_, v, u) in enumerate(rows)]
    line = " ".join(f"{x:.2f},{y:.2f}" for x, y, _ in points)
    band = " ".join(f"{x:.2f},{y - u:.2f}" for x, y, u in points)
    back = " ".join(f"{x:.2f},{y + u:.2f}" for x, y, u in reversed(points))
    return Markup(
        '<svg class="trend" viewBox="0 0 100 100" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="u" d="M{band} {back}Z"/><path d="M{line}"/></svg>'
    )


def page_server(page: Page, port: int = 0) -> LocalServer:
    """A server of the page, which takes posts and uploads too.

    Raises:
        OutputError: the port cannot be had.
    """
    scripts = f"{script_source(page.script)} {script_source(viewer_script())}"
    return LocalServer(page, port, script_source=scripts, takes=("GET", "HEAD", "POST", "PUT"))


def serve(folder: Path, port: int, *, browser: bool, tell: Callable[[str], None]) -> None:
    """Serve until interrupted; `tell` gets the address.

    Raises:
        InputError, OutputError: as Page, as page_server.
        KeyboardInterrupt: somebody ended it.
    """
    page = Page(folder)
    try:
        with page_server(page, port) as server:
            serve_at(server, server.address, browser, tell)
    finally:
        page.close()
