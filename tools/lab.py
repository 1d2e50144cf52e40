"""Open the course in JupyterLab: the learner's copies first, then the server.

`python -m tools.lab` (or `make lab`) brings the copies of all notebooks under `work/` up to date,
writes the home page anew from the learner's progress, and starts JupyterLab on it. It says one line
a step; what the server has to say goes to `build/lab.log`, and only what is critical, such as the
address, to the terminal. Further arguments are JupyterLab's.
"""

import functools
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from course.simulations import LIVE_TAG
from drills import chapters, notebook
from drills.chapters import ROOT, Copy
from drills.workspace import Misuse, shown

LOG = ROOT / "build" / "lab.log"
HOME_TAG = "home"
_CALL = re.compile(r"^simulation\(\"(\w+)\"", re.M)


def copies(work: Path, folder: Path = ROOT / "notebooks") -> Iterator[Copy]:
    """Bring the copy of every notebook up to date, and the home page in the copy of the index.

    Args:
        work: the learner's folder.
        folder: of the course's notebooks.

    Raises:
        Misuse: a notebook can't be read, or its copy can't be written.
    """
    for source in sorted(folder.glob("*.ipynb")):
        copy = chapters.bring(source, work)
        changed = copy.state in ("made", "brought up to date", "set aside")
        if not chapters.open_in_jupyter(copy.path):
            changed |= chapters.name_kernel(copy.path, kernel())
        if source.stem == chapters.HOME and not chapters.open_in_jupyter(copy.path):
            page = notebook.home()._repr_mimebundle_()
            changed |= chapters.show_in(copy.path, HOME_TAG, page)
            if moving := _live(source):
                changed |= chapters.show_in(copy.path, LIVE_TAG, moving)
        if changed:
            trust(copy.path)
        yield copy


@functools.cache
def kernel() -> dict[str, Any]:
    """Return what JupyterLab writes into a notebook that runs on this Python's kernel."""
    from ipykernel.ipkernel import IPythonKernel
    from ipykernel.kernelspec import get_kernel_dict

    spec = get_kernel_dict()
    return {
        "kernelspec": {
            "display_name": spec["display_name"],
            "language": spec["language"],
            "name": "python3",
        },
        "language_info": dict(IPythonKernel.language_info),
    }


def _live(index: Path) -> dict[str, Any] | None:
    """Return the output of the home page's simulation: one that runs in the page, without a kernel.

    Args:
        index: the course's home page, which has a picture of it.
    """
    from course.simulations import declaration

    for cell in json.loads(index.read_text(encoding="utf-8"))["cells"]:
        if LIVE_TAG in cell["metadata"].get("tags", ()):
            modules = {name.rpartition(".")[2]: name for name in declaration.names()}
            (name,) = _CALL.findall("".join(cell["source"]))
            data = cell["outputs"][0]["data"]
            picture = "".join(data["image/png"]).replace("\n", "")
            return {**data, "text/html": declaration.inline(modules[name], picture)}
    return None


def trust(path: Path) -> None:
    """Sign a copy, so that JupyterLab shows its saved pictures before anything is run."""
    import nbformat
    from nbformat.sign import NotebookNotary

    with NotebookNotary() as notary:
        notary.sign(nbformat.read(path, as_version=4))


def server_options(log: Path, arguments: list[str]) -> list[str]:
    """Return how JupyterLab is started: on the home page, its words in a file.

    Args:
        log: the file.
        arguments: further options.
    """
    handlers = {
        "console": {
            "class": "logging.StreamHandler",
            "level": "CRITICAL",
            "formatter": "plain",
            "stream": "ext://sys.stdout",
        },
        "file": {"class": "logging.FileHandler", "formatter": "dated", "filename": str(log)},
    }
    formatters = {
        "plain": {"format": "%(message)s"},
        "dated": {"format": "%(asctime)s %(levelname)s %(name)s: %(message)s"},
    }
    named = {"level": "INFO", "handlers": list(handlers)}
    loggers = {"LabApp": named, "ServerApp": named}
    config = {"version": 1, "handlers": handlers, "formatters": formatters, "loggers": loggers}
    options = [
        f"--ServerApp.root_dir={ROOT}",
        f"--LabApp.default_url=/lab/tree/work/{chapters.HOME}.ipynb",
        f"--Application.logging_config={config!r}",
    ]
    if sys.platform != "darwin" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        options.append("--no-browser")
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        options.append("--allow-root")
    return options + arguments


def main(arguments: list[str]) -> int:
    """Bring the copies up to date and serve them until the server is stopped."""
    work = ROOT / "work"
    try:
        report = [sentence for copy in copies(work) if (sentence := copy.sentence())]
    except Misuse as problem:
        print(problem, file=sys.stderr)
        return 2
    print("\n".join(report) or f"your copies of the notebooks in {shown(work)} are up to date")
    options = server_options(LOG, arguments)
    print("opening JupyterLab; Ctrl-C twice ends it")
    if "--no-browser" in options:
        print("no display: open the address below in a browser")
    sys.stdout.flush()
    _write_errors_to(LOG)

    from jupyterlab.labapp import LabApp

    try:
        LabApp.launch_instance(options)
    except SystemExit as end:
        if end.code:
            print(f"JupyterLab could not go on; {shown(LOG)} says why")
        raise
    return 0


def _write_errors_to(log: Path) -> None:
    """Open the log, readable only by its owner as it holds the address, and send errors there.

    Complaints of the kernels go to the same file.
    """
    log.parent.mkdir(exist_ok=True)
    log.unlink(missing_ok=True)
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(handle, 2)
    os.close(handle)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
