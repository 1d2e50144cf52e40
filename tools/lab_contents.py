"""How JupyterLab decides that a notebook has changed on disk: by what a person wrote in it.

Before each save JupyterLab asks the server for a hash of the file. If it is not the hash of what
this window last loaded or saved, a dialog asks whether to overwrite the file. With a notebook open
in two windows that happens as soon as both have run a cell, although nobody edited a text: a run
changes outputs, counters and metadata.

`Contents` hashes what a person writes instead: the kind, the text, the attachments and the tags of
each cell, in their order. So a window saves over outputs of another one, which running the cells
brings back, and the dialog still appears before any text would be lost.

`make lab` turns it on through the folder `.jupyter`.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

from jupyter_server.services.contents.largefilemanager import AsyncLargeFileManager


def hash_of_text(notebook: dict[str, Any]) -> str:
    """Return a hash of what a person wrote in a notebook.

    Outputs, counters, identifiers and metadata other than tags do not change it. A text is the same
    as one string or as a list of lines, which is how a file has it.

    Args:
        notebook: of format 4, as JSON has it.

    Raises:
        KeyError: it has no list of cells of this format.
    """
    written = [
        (
            cell["cell_type"],
            "".join(cell["source"]),
            cell.get("attachments") or {},
            cell["metadata"].get("tags", []),
        )
        for cell in notebook["cells"]
    ]
    return hashlib.sha256(json.dumps(written, sort_keys=True).encode()).hexdigest()


class Contents(AsyncLargeFileManager):
    """Jupyter Server's own manager of files, with another hash of notebooks."""

    async def get(
        self,
        path: str,
        content: bool = True,
        type: str | None = None,
        format: str | None = None,
        require_hash: bool = False,
    ) -> dict[str, Any]:
        """Return the model of a file or folder, as Jupyter Server describes it.

        A notebook has the hash of its text, also where it is opened as plain text: JupyterLab's
        request before a save does not say how a file is open. Any other file has that of its
        bytes.
        """
        # The hash first: if the file changes before it is read, a save asks once too often. The
        # other way round a save would overwrite what nobody has seen.
        text = self._hash_of(path) if require_hash and path.endswith(".ipynb") else None
        model: dict[str, Any] = await super().get(path, content, type, format, require_hash)
        return model | ({"hash": text, "hash_algorithm": "sha256"} if text else {})

    def _hash_of(self, path: str) -> str | None:
        """Return the hash of a notebook's text; None where there is no notebook of format 4."""
        try:
            return hash_of_text(json.loads(Path(self._get_os_path(path)).read_bytes()))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
