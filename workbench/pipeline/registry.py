"""Which stages there are: families by entry point, imported only when a pipeline names them.

Group `workbench.stages`: the entry point's name is the family, its value the module that defines the stages. The
project's own families come by the same door as a stranger's plug-in; should the installation's metadata be stale or
absent (a plain checkout on the path), they are found by their names.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import sys
import traceback
from importlib.metadata import entry_points
from pathlib import Path

from workbench.errors import PipelineError, nearest
from workbench.stage import GROUP, REGISTRY, Stage

FILES: dict[str, str] = {}  # SHA-256 of plug-ins of one file, by module: run.json names them
BUILT_IN = ("scan", "cloud", "edge", "path", "program", "inspect", "twin", "report")


@functools.cache
def families() -> dict[str, tuple[str, ...]]:
    """Modules by family name: the project's own first, then those of plug-ins."""
    found = {family: [f"workbench.{family}"] for family in BUILT_IN}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        modules = found.setdefault(entry.name, [])
        if entry.value not in modules:
            modules.append(entry.value)
    return {family: tuple(modules) for family, modules in found.items()}


def find(name: str, where: str) -> Stage:
    """The stage `name`; raises PipelineError at `where` with the nearest known name."""
    family = name.partition(".")[0]
    if name not in REGISTRY and family in families():
        load(family)
    if name not in REGISTRY:
        known, broken = every_stage()
        hint = f" ({broken[family]})" if family in broken else nearest(name, known)
        raise PipelineError(where, f"unknown stage '{name}'{hint}")
    return REGISTRY[name]


def load_file(path: str | Path) -> None:
    """Run a file of stages (`--plugin FILE.py`): a plug-in that is not installed.

    Raises:
        PipelineError: no such file, no Python, it fails while it runs, or it defines no stage.
    """
    where, before = Path(path), set(REGISTRY)
    name = f"workbench_plugin_{where.stem}"
    if where.suffix != ".py" or not name.isidentifier():
        raise PipelineError(f"--plugin {path}", "expected a file NAME.py, its name letters, digits and _")
    spec = importlib.util.spec_from_file_location(name, where)
    if not where.is_file() or spec is None or spec.loader is None:
        raise PipelineError(f"--plugin {path}", "no such file")
    FILES[name] = hashlib.sha256(where.read_bytes()).hexdigest()
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except PipelineError:
        raise
    except Exception as error:  # a plug-in may fail in any way while it is imported
        line = next(
            (
                frame.lineno
                for frame in reversed(traceback.extract_tb(error.__traceback__))
                if frame.filename == str(where)
            ),
            getattr(error, "lineno", None),
        )
        place = f"--plugin {path}" + (f": line {line}" if line else "")
        raise PipelineError(place, f"cannot be run: {type(error).__name__}: {error}") from error
    if not set(REGISTRY) - before and not any(one.function.__module__ == name for one in REGISTRY.values()):
        raise PipelineError(f"--plugin {path}", "defines no stage: expected a function under @stage('family.verb')")


def load(family: str) -> None:
    """Import the modules of one family; raises PipelineError if one cannot be imported."""
    for module in families()[family]:
        try:
            importlib.import_module(module)
        except PipelineError:
            raise
        except Exception as error:  # a plug-in may fail in any way while it is imported
            why = f"cannot be imported: {type(error).__name__}: {error}"
            raise PipelineError(f"stages '{family}.*' ({module})", why) from error


def every_stage() -> tuple[dict[str, Stage], dict[str, str]]:
    """All stages by name, and by family why one cannot be had."""
    broken = {}
    for family in families():
        try:
            load(family)
        except PipelineError as error:
            broken[family] = str(error)
    return dict(sorted(REGISTRY.items())), broken
