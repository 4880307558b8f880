"""The pipelines and sample data that come with the project, as files of the user's own."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from workbench.errors import ArgumentError, InputError, OutputError, nearest

FOLDERS = ("pipelines", "data")


def copy_samples(target: Path) -> tuple[Path, ...]:
    """Copy `pipelines/` and `data/` into the directory `target`, made where it does not exist; all of them or none.

    Raises:
        OutputError: one of them is there already, or cannot be written.
        InputError: this installation came without them.
    """
    source = _source()
    for name in FOLDERS:
        if (target / name).exists():
            raise OutputError(str(target / name), "is there already; choose another directory")
    try:
        target.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".samples-", dir=target) as staged:
            for name in FOLDERS:
                shutil.copytree(source / name, Path(staged) / name, ignore=shutil.ignore_patterns("__pycache__"))
            for name in FOLDERS:
                (Path(staged) / name).rename(target / name)
    except (OSError, shutil.Error) as error:
        raise OutputError(str(target), f"cannot be written: {getattr(error, 'strerror', None) or error}") from None
    return tuple(target / name for name in FOLDERS)


def shipped_pipeline(name: str) -> str:
    """The path of a pipeline that comes with the project, for its bare name; anything else as it is given.

    ArgumentError: no file has this name, and none of these.

    Example:
        >>> from workbench.samples import shipped_pipeline
        >>> shipped_pipeline("my/own.json")
        'my/own.json'
    """
    if name.isidentifier() and not Path(name).exists():
        place = _source() / "pipelines" / f"{name}.json"
        if place.is_file():
            return str(place)
        raise ArgumentError(name, f"cannot be read: No such file or directory{nearest(name, pipelines())}")
    return name


def pipelines() -> list[str]:
    """Names of the pipelines that come with the project."""
    return sorted(path.stem for path in (_source() / "pipelines").glob("*.json"))


def _source() -> Path:
    """Inside the installed package; beside it in a checkout."""
    package = Path(__file__).parent
    for place in (package / "shipped", package.parent):
        if all((place / name).is_dir() for name in FOLDERS):
            return place
    raise InputError(str(package), "expected the folders pipelines and data: the installation is not whole")
