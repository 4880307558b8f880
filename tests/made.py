"""The files that a run writes of artefacts, which stages of our own hand it."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from workbench.api import stage
from workbench.pipeline import Pipeline
from workbench.stage import REGISTRY


def files_of(*artefacts: Any) -> dict[str, bytes]:
    """Content by name, `run.json` left out."""
    names = [f"made.number_{k}" for k in range(len(artefacts))]
    try:
        for name, artefact in zip(names, artefacts, strict=True):
            _hands_on(name, artefact)
        with TemporaryDirectory() as folder:
            Pipeline({"version": 1, "stages": [{"stage": name} for name in names]}).run(Path(folder, "out"))
            files = {path.name: path.read_bytes() for path in Path(folder, "out").iterdir()}
    finally:
        for name in names:
            REGISTRY.pop(name, None)
    del files["run.json"]
    return files


def _hands_on(name: str, artefact: Any) -> None:
    def make():  # type: ignore[no-untyped-def]  # its type is known below only
        """Hand it on."""
        return artefact

    make.__annotations__["return"] = type(artefact)
    stage(name)(make)
