"""Packages that come with an extra: imported when they are first used, named in one line where they are missing."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from workbench.errors import InputError

DISTRIBUTION = "bevel-workbench"
EXTRA_OF = {  # by the name under which Python imports a package
    **dict.fromkeys(("fcl", "pinocchio", "xacro"), "robot"),
    **dict.fromkeys(("ezdxf", "laspy", "pyarrow", "pye57"), "formats"),
    **dict.fromkeys(("starlette", "uvicorn"), "page"),
    "gmsh": "cad",
    "pyvista": "view",
    "distributed": "cluster",
    "s3fs": "s3",
}


class Extra:
    """A module of an extra. Raises InputError, with what to install, where it is used and not there."""

    def __init__(self, module: str) -> None:
        """Nothing is imported yet."""
        self._module = module

    def __getattr__(self, name: str) -> Any:
        """What the module has under this name; looked up once."""
        try:
            found = getattr(importlib.import_module(self._module), name)
        except ModuleNotFoundError as error:
            raise (not_installed(error.name or "") or error) from None
        setattr(self, name, found)
        return found


def not_installed(module: str) -> InputError | None:
    """That a module of an extra is missing, and what brings it; None for one of no extra."""
    package = module.partition(".")[0]
    extra = EXTRA_OF.get(package)
    return InputError(package, f"is not installed: pip install '{DISTRIBUTION}[{extra}]'") if extra else None


def require(*packages: str) -> None:
    """Raise InputError for the first of an extra's packages that is not there, before work is begun that needs it."""
    for package in packages:
        if importlib.util.find_spec(package) is None and (missing := not_installed(package)):
            raise missing
