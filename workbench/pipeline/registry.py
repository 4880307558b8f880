"""Which stages there are: families by entry point, imported only when a pipeline names them.

Group `workbench.stages`: the entry point's name is the family, its value the module that defines the stages. The
project's own families come by the same door as a stranger's plug-in; should the installation's metadata be stale or
absent (a plain checkout on the path), they are found by their names.
"""

from __future__ import annotations

import functools
import importlib
from importlib.metadata import entry_points

from workbench.errors import PipelineError, nearest
from workbench.stage import REGISTRY, Stage

GROUP = "workbench.stages"
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
