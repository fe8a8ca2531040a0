"""Conversion of notebooks to Markdown: text, code, and the stored outputs."""

import base64
import json
from pathlib import Path
from typing import Any


def joined(text: str | list[str]) -> str:
    """Return a text that a notebook stores as one string or as a list of lines."""
    return text if isinstance(text, str) else "".join(text)


def code_of(cell: dict[str, Any]) -> str:
    """Return the source of a cell."""
    return joined(cell["source"])


def notebook_to_markdown(path: Path) -> tuple[str, dict[str, bytes]]:
    """Return the page of a notebook, and the pictures it shows by file name.

    Args:
        path: an `.ipynb` file of format 4, with the outputs of its last run.
    """
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    for cell in cells:
        if cell["cell_type"] == "markdown":
            parts.append(code_of(cell))
            continue
        parts.append(f"```python\n{code_of(cell)}\n```")
        for output in cell["outputs"]:
            name = f"{path.stem}_{len(pictures)}.png"
            data = output.get("data", {})
            if "image/png" in data:
                pictures[name] = base64.b64decode(joined(data["image/png"]))
                parts.append(f"![Output of the cell above]({name})")
            else:
                said = joined(output.get("text", data.get("text/plain", "")))
                parts.append(f"```text\n{said.rstrip()}\n```")
    return "\n\n".join(parts) + "\n", pictures
