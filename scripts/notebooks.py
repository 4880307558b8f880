"""The notebooks of docs/notebooks: each NAME.py (cells after `# %%`) run and written as NAME.ipynb with its outputs."""

import base64
import contextlib
import io
import sys
from pathlib import Path
from typing import Any

import nbformat
from IPython.core.interactiveshell import InteractiveShell
from IPython.utils.capture import capture_output

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "docs" / "notebooks"
TEXT = "text/plain"


def cells(source: str) -> list[tuple[bool, str]]:
    """(is code, text) of each cell."""
    found = []
    for block in source.split("# %%")[1:]:
        head, _, body = block.partition("\n")
        code = "[markdown]" not in head
        lines = body.strip("\n").split("\n")
        text = lines if code else [line.removeprefix("#").removeprefix(" ") for line in lines]
        found.append((code, "\n".join(text).strip("\n")))
    return found


def executed(source: str) -> Any:
    """The notebook with what its cells print and return; a cell that fails raises."""
    shell, notebook = InteractiveShell.instance(), nbformat.v4.new_notebook()
    for code, text in cells(source):
        if not code:
            notebook.cells.append(nbformat.v4.new_markdown_cell(text))
            continue
        cell = nbformat.v4.new_code_cell(text)
        with capture_output() as captured, contextlib.redirect_stderr(io.StringIO()):
            result = shell.run_cell(text, store_history=True, silent=False)
        result.raise_error()
        cell.execution_count = shell.execution_count - 1
        if result.result is not None:
            data, _ = shell.display_formatter.format(result.result, include={TEXT, "image/png"})
            data = {
                kind: base64.b64encode(one).decode() if isinstance(one, bytes) else one for kind, one in data.items()
            }
            output = nbformat.v4.new_output("execute_result", data, execution_count=cell.execution_count)
            cell.outputs.append(output)
        del captured
        notebook.cells.append(cell)
    for k, cell in enumerate(notebook.cells):
        cell.id = f"cell-{k}"
    notebook.metadata.kernelspec = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return notebook


def main() -> int:
    sys.path.insert(0, str(ROOT))
    for path in sorted(FOLDER.glob("*.py")):
        nbformat.write(executed(path.read_text()), path.with_suffix(".ipynb"))
        print(path.with_suffix(".ipynb").relative_to(ROOT))
    return 0


if __name__ == "__main__":
    sys.exit(main())
