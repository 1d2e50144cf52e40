"""How much an installation loads and keeps, for what the set-up announces.

`python -m tools.sizes`, in a fresh `.venv`, prints the two figures that the Makefile announces
before the first install. What is loaded is what the installed files take when they are compressed
as in a wheel; what is kept is what they take on the disk.
"""

import importlib.metadata
import zlib
from pathlib import Path

_CHUNK = 1 << 24  # bytes


def packed(path: Path) -> int:
    """Return bytes of a file, compressed as a wheel compresses it."""
    engine, size = zlib.compressobj(6, zlib.DEFLATED, -15), 0
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            size += len(engine.compress(chunk))
    return size + len(engine.flush())


def measured() -> tuple[int, int, int]:
    """Return how many packages are installed here, and their bytes as loaded and as kept."""
    loaded = retained = 0
    packages = {one.metadata["Name"]: one for one in importlib.metadata.distributions()}
    for package in packages.values():
        for entry in package.files or ():
            path = Path(str(package.locate_file(entry)))
            if path.is_file():
                retained += path.stat().st_size
                loaded += 0 if path.suffix == ".pyc" else packed(path)
    return len(packages), loaded, retained


if __name__ == "__main__":
    count, loaded, stored = measured()
    print(f"{count} packages: {loaded / 1e9:.1f} GB to load, {stored / 1e9:.1f} GB on disk")
