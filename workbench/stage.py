"""What a stage is: a typed function from artefacts to artefacts, under one name.

Positional parameters are artefacts, found by type; keyword-only ones are parameters, checked by pydantic from their
annotation. Documents, `workbench stages`, the JSON Schema, the docs pages and the contract tests all read this one
signature, and a notebook calls the same function.
"""

from __future__ import annotations

import functools
import inspect
import re
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar, Union, get_args, get_origin, get_type_hints

from workbench.errors import PipelineError
from workbench.parameters import check_parameters, parameter_model

if TYPE_CHECKING:
    from pydantic import BaseModel


class Role(Enum):
    """What a keyword-only parameter is to the runner, beyond a plain value."""

    INPUT_FILE = "input file"
    SEED = "seed"
    PROGRESS = "progress"


if TYPE_CHECKING:
    InputFile: TypeAlias = Any  # callers give a text or a Path, the stage's function gets a Path
else:
    InputFile = Annotated[Path, Role.INPUT_FILE]
"""A file that a stage reads: relative to the pipeline's own file, recorded with its SHA-256."""
Seed = Annotated[int, Role.SEED]
"""The seed of a stage's random numbers: the pipeline's, unless the stage is given its own."""
Progress = Annotated[Callable[[float], None] | None, Role.PROGRESS]
"""`progress(fraction)` with 0 <= fraction <= 1, called by a long stage now and then; None: nobody looks."""


@dataclass(frozen=True)
class AtLeast:
    """Marks a parameter that may not be below another: the one of this name of the stage that made its artefact."""

    name: str
    made: type  # the artefact whose stages are followed back


RESERVED = ("stage", "id", "from", "write")  # keys of a stage in a pipeline that are not parameters
F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class Source:
    """A positional parameter of a stage: the artefact, or all artefacts, of one type."""

    name: str
    type: type
    several: bool = False
    required: bool = True
    nullable: bool = False  # its stage can do without the value


@dataclass(frozen=True, repr=False)
class Stage:
    """A registered stage: its function and what its signature says (read on first use)."""

    name: str
    function: Callable[..., Any]
    ahead: Callable[..., str] | None = None

    def __repr__(self) -> str:
        """Its name alone."""
        return f"Stage({self.name!r})"

    @property
    def doc(self) -> str:
        """The function's docstring, without indentation."""
        return inspect.getdoc(self.function) or ""

    @functools.cached_property
    def hints(self) -> dict[str, Any]:
        """Evaluated annotations by name; `return` is the result's."""
        try:
            return get_type_hints(self.function, include_extras=True)
        except NameError as error:
            raise self._defect(f"annotation cannot be evaluated at run time: {error}") from None

    @functools.cached_property
    def sources(self) -> tuple[Source, ...]:
        """The artefacts it takes, in order."""
        found = [
            _source(name, self.hints[name], parameter.default is parameter.empty)
            for name, parameter in self._signature(inspect.Parameter.POSITIONAL_OR_KEYWORD)
        ]
        for source in found:
            if not isinstance(source.type, type):
                raise self._defect(f"'{source.name}' is not an artefact's type, but {source.type}")
        return tuple(found)

    @functools.cached_property
    def produces(self) -> tuple[type, ...]:
        """The types of the artefacts it returns; where it says `X | None` a run may do without."""
        return tuple(_made(self.hints.get("return", type(None))))

    @functools.cached_property
    def parameters(self) -> dict[str, Role | None]:
        """Keyword-only parameters and their roles."""
        names = [name for name, _ in self._signature(inspect.Parameter.KEYWORD_ONLY)]
        return {name: next(_roles(self.hints[name]), None) for name in names}

    @functools.cached_property
    def floors(self) -> dict[str, AtLeast]:
        """What parameters may not be below, by name."""
        marks = {name: getattr(self.hints[name], "__metadata__", ()) for name in self.parameters}
        return {name: one for name, several in marks.items() for one in several if isinstance(one, AtLeast)}

    @functools.cached_property
    def model(self) -> type[BaseModel]:
        """The pydantic model of the parameters."""
        fields = {
            name: (self.hints[name], ... if parameter.default is parameter.empty else parameter.default)
            for name, parameter in self._signature(inspect.Parameter.KEYWORD_ONLY)
            if self.parameters[name] is not Role.PROGRESS
        }
        return parameter_model(self.name, fields)

    def validate(self, given: Mapping[str, Any], where: str | None = None) -> dict[str, Any]:
        """All parameters as the function takes them, defaults included.

        Raises PipelineError at `where` (the stage's name if None) with the place inside, what was expected and the
        nearest known name.
        """
        return check_parameters(self.model, given, where or self.name)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run on artefacts (positional, or by name) with parameters by name; files may stand behind the artefacts."""
        kinds = {source.name: source for source in self.sources}
        args, kwargs = self._files_by_name(args, kwargs)
        args = tuple(_taken(source, one) for source, one in zip(self.sources, args, strict=False))
        kwargs = {key: _taken(kinds[key], one) if key in kinds else one for key, one in kwargs.items()}
        passed = {key: value for key, value in kwargs.items() if key in kinds or self._is_progress(key)}
        parameters = self.validate({key: value for key, value in kwargs.items() if key not in passed})
        placed = dict(zip(kinds, args, strict=False))
        for name, source in kinds.items():
            if name in placed and name in passed:
                raise PipelineError(f"{self.name}.{name}", "given twice, by position and by name")
            if name in placed or name in passed:
                self._check_source(source, placed.get(name, passed.get(name)))
            elif source.required:
                raise PipelineError(f"{self.name}.{name}", f"missing: expected {_expected(source)}")
        return self.function(*args, **passed, **parameters)

    def _files_by_name(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Paths that stand behind the artefacts get the names of the files that the stage reads, in their order."""
        count = len(self.sources)
        files = [name for name, role in self.parameters.items() if role is Role.INPUT_FILE and name not in kwargs]
        rest = args[count:]
        if len(rest) > len(files) or not all(isinstance(one, str | Path) for one in rest):
            shown = ", ".join([*(source.name for source in self.sources), *files]) or "none"
            raise PipelineError(self.name, f"expected at most these by position: {shown}; got {len(args)} values")
        return args[:count], kwargs | dict(zip(files, rest, strict=False))

    def _is_progress(self, key: str) -> bool:
        return self.parameters.get(key) is Role.PROGRESS

    def _check_source(self, source: Source, value: Any) -> None:
        where = f"{self.name}.{source.name}"
        if value is None and (source.nullable or not source.required):
            return
        if source.several and not isinstance(value, list | tuple):
            raise PipelineError(where, f"expected {_expected(source)}, got {_got(value, source)}")
        for one in value if source.several else [value]:
            if not isinstance(one, source.type):
                raise PipelineError(where, f"expected {_expected(source)}, got {_got(one, source)}")

    def _signature(self, kind: Any) -> list[tuple[str, inspect.Parameter]]:
        """The function's parameters of one kind; refuses signatures that no pipeline could fill."""
        parameters = inspect.signature(self.function).parameters
        for name, parameter in parameters.items():
            if parameter.kind not in (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY):
                raise self._defect(f"parameter '{name}' is variadic or positional-only")
            if name in RESERVED or name not in self.hints:
                raise self._defect(f"parameter '{name}' has a reserved name or no annotation")
        return [(name, parameter) for name, parameter in parameters.items() if parameter.kind is kind]

    def _defect(self, text: str) -> PipelineError:
        return PipelineError(f"stage {self.name} ({self.function.__module__})", text)


REGISTRY: dict[str, Stage] = {}
GROUP = "workbench.stages"  # entry points of families of stages
MOST_MAKERS = 4  # named in a message


def bring(family: Any, verb: str = "") -> None:
    """Import all stages of a family's module, or one: the project's own families import each when it is asked for."""
    for each in getattr(family, "__all__", ()):
        if verb in ("", each):
            getattr(family, each)


def _expected(source: Source) -> str:
    """What a source is, and the stages that make it, those first that do not take one themselves."""
    from importlib.metadata import entry_points  # slow to load, and only refusals ask

    for entry in entry_points(group=GROUP):
        with suppress(Exception):  # a plug-in that cannot be imported makes nothing
            bring(entry.load())
    makers = sorted(
        (any(issubclass(source.type, one.type) for one in stage.sources), name)
        for name, stage in REGISTRY.items()
        if any(issubclass(made, source.type) for made in stage.produces)
    )
    shown = ", ".join(name for _, name in makers[:MOST_MAKERS]) + (", ..." if len(makers) > MOST_MAKERS else "")
    name = f"a list of {source.type.__name__}" if source.several else f"one {source.type.__name__}"
    return name + (f" (made by {shown})" if makers else "")


def _of_open3d(value: Any) -> bool:
    """Whether it is one of Open3D's two kinds of point clouds."""
    return type(value).__name__ == "PointCloud" and type(value).__module__.startswith("open3d.")


def _taken(source: Source, value: Any) -> Any:
    """Open3D's point cloud as the artefact that has nothing but points; anything else as it is."""
    make = getattr(source.type, "from_open3d", None)
    return make(value) if make and _of_open3d(value) else value


def _got(value: Any, source: Source) -> str:
    """What was given instead, with what to do where that is plain."""
    if isinstance(value, str | Path):
        return f"the path or text {str(value)!r}: read it first"
    if _of_open3d(value):
        return "a PointCloud of Open3D: it has no profiles, and is taken where a PointSet is"
    if isinstance(value, list | tuple):
        parts = [type(one).__name__ for one in value]
        fits = [i for i, one in enumerate(value) if isinstance(one, source.type)]
        advice = f": give its part [{fits[0]}]" if fits else ""
        return f"a {type(value).__name__} of {len(parts)} values ({', '.join(parts[:MOST_MAKERS])}){advice}"
    alone = ": put it in a list" if source.several and isinstance(value, source.type) else ""
    return "None" if value is None else type(value).__name__ + alone


def stage(name: str, ahead: Callable[..., str] | None = None) -> Callable[[F], F]:
    """Register a function as the stage `name` ('family.verb'); the function returned checks its parameters.

    `ahead` takes some of its artefacts and parameters, by name, and tells what they alone decide: it raises what the
    stage would refuse, and returns what it would say, or ''. A run asks it before the stages that they do not wait for.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*", name):
        raise PipelineError(f"stage {name!r}", "expected a name like 'family.verb' in lower case")

    def register(function: F) -> F:
        place = (function.__module__, function.__qualname__)
        known = REGISTRY.get(name)
        if known and (known.function.__module__, known.function.__qualname__) != place:
            raise PipelineError(f"stage {name}", f"registered by {known.function.__module__} and by {place[0]}")
        REGISTRY[name] = entry = Stage(name, function, ahead)

        @functools.wraps(function)
        def checked(*args: Any, **kwargs: Any) -> Any:
            return entry(*args, **kwargs)

        return checked  # type: ignore[return-value]  # same signature as `function`

    return register


def _source(name: str, hint: Any, required: bool) -> Source:
    """Read `X`, `X | None`, `tuple[X, ...]` or a sequence of X."""
    nullable = get_origin(hint) in (Union, types.UnionType)
    if nullable:
        hint = next(part for part in get_args(hint) if part is not type(None))
    if get_origin(hint) in (tuple, list, Sequence):
        return Source(name, get_args(hint)[0], several=True, required=required)
    return Source(name, hint, required=required, nullable=nullable)


def _made(hint: Any) -> Iterator[type]:
    """The types in `X`, `X | None` or a tuple of these."""
    if get_origin(hint) in (tuple, Union, types.UnionType):
        for part in get_args(hint):
            yield from _made(part)
    elif hint is not type(None) and hint is not Ellipsis:
        yield hint


def _roles(hint: Any) -> Iterator[Role]:
    """Roles named anywhere in an annotation."""
    if get_origin(hint) is Annotated:
        yield from (mark for mark in hint.__metadata__ if isinstance(mark, Role))
    for part in get_args(hint):
        if get_origin(part) is not None:
            yield from _roles(part)
