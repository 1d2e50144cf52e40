"""Compile the hot loops of every chapter that is there, so that later runs start at once.

`python -m course.warm` (or `make warm`) calls the function `warm()` of each chapter that has one.
"""

import importlib
import time

from course import CHAPTERS


def warm_chapters() -> dict[str, float]:
    """Compile, or load from the disk cache, the hot loops of the chapters that are there.

    Returns:
        Seconds each chapter's `warm()` took, by topic.
    """
    seconds = {}
    for chapter in CHAPTERS:
        if not chapter.there:
            continue
        module = importlib.import_module(chapter.module)
        if hasattr(module, "warm"):
            start = time.perf_counter()
            module.warm()
            seconds[chapter.topic] = time.perf_counter() - start
    return seconds


def main() -> None:
    """Warm the cache and print what it took."""
    seconds = warm_chapters()
    # Imported after the chapters, so that this module itself stays light.
    from course.compiled import COMPILE_SECONDS

    for topic, spent in seconds.items():
        print(f"{topic}: compiled code ready in {spent:.1f} s")
    compiling = sum(COMPILE_SECONDS.values())
    print(f"{len(COMPILE_SECONDS)} compiled functions, {compiling:.1f} s to compile or load them")


if __name__ == "__main__":
    main()
