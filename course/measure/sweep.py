"""Many runs of one function, here or anywhere: seeds, ablations, maps of success.

The caller chooses where jobs run, any `concurrent.futures.Executor`: processes of this
machine, or a cluster by one line (Dask: `distributed.Client(address).get_executor()`). The results
are the same at any number of workers, as long as each job has its own seed among its arguments.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, as_completed
from pathlib import Path
from typing import Any, TypeVar

from course.check import invalid

Result = TypeVar("Result")
Job = Mapping[str, Any]


class JobsFailed(RuntimeError):
    """Some jobs of a sweep failed, and all the others are done.

    Attributes:
        results: of each job, in their order; None where it failed.
        errors: number of a job -> what it raised.
    """

    def __init__(self, text: str, results: list[Any], errors: dict[int, BaseException]) -> None:
        super().__init__(text)
        self.results, self.errors = results, errors


def sweep(
    function: Callable[..., Result],
    jobs: Sequence[Job],
    executor: Executor | None = None,
    *,
    saved: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Result]:
    """Call a function with each job's arguments.

    Args:
        function: at the top level of a module where another process is to find it.
        jobs: keyword arguments of each call; no two alike. Compared by their text, so arguments are
            numbers, words and dataclasses of them rather than arrays.
        executor: who runs them; None for this process, one after the other.
        saved: a file for the results that are there, written whole after each job and read first:
            a sweep that was interrupted goes on where it was. Delete it when the function changes.
        progress: called with the jobs that are done and all; None for a line on standard error at
            each tenth where that is a terminal, unless COURSE_QUIET is 1.

    Returns:
        The results in the order of the jobs.

    Raises:
        ValueError: for two jobs alike, and a file of another function.
        JobsFailed: once all others are done, with the arguments of those that failed.
    """
    # The text of its arguments identifies a job, also in a file of an earlier sweep.
    names = [_text(job) for job in jobs]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise invalid(
            "jobs", f"two of {{{twice}}}", "jobs that differ, by a seed if by nothing else"
        )
    owner = f"{function.__module__}.{function.__qualname__}"
    done = _read(saved, owner) if saved else {}
    remaining = [i for i, name in enumerate(names) if name not in done]
    errors: dict[int, BaseException] = {}
    # Results are stored as they come, so that an interruption loses only what was running.
    for over, (i, result, error) in enumerate(_run(function, jobs, remaining, executor), 1):
        if error is None:
            done[names[i]] = result
            if saved:
                _write(saved, owner, done)
        else:
            errors[i] = error
        (progress or _report_progress)(len(names) - len(remaining) + over, len(names))
    results: list[Any] = [done.get(name) for name in names]
    # All other jobs are done by now, and stored: only then is the failure raised.
    if errors:
        message = [f"({names[i]}): {type(e).__name__}: {e}" for i, e in sorted(errors.items())]
        more = [f"and {len(message) - 5} more"] if len(message) > 5 else []
        text = f"{len(errors)} of {len(names)} jobs failed: " + "; ".join(message[:5] + more)
        if any(isinstance(e, BrokenExecutor) for e in errors.values()) and saved:
            text += f". The executor broke; what is done is in {saved}: sweep again with a new one"
        raise JobsFailed(text, results, errors) from next(iter(errors.values()))
    return results


def _run(
    function: Any, jobs: Sequence[Job], remaining: list[int], executor: Executor | None
) -> Iterator[tuple[int, Any, BaseException | None]]:
    """Yield each job as it finishes: its number, and its result or what it raised."""
    if executor is None:
        for i in remaining:
            try:
                yield i, function(**jobs[i]), None
            except Exception as error:
                yield i, None, error
        return
    futures: dict[Any, int] = {}
    for i in remaining:
        try:
            futures[executor.submit(function, **jobs[i])] = i
        except BrokenExecutor as error:  # a worker died while we were still handing out
            yield i, None, error
    for future in as_completed(futures):
        raised = future.exception()
        yield futures[future], None if raised else future.result(), raised


def _text(job: Job) -> str:
    return ", ".join(f"{name}={job[name]!r}" for name in sorted(job))


def _read(path: str | Path, owner: str) -> dict[str, Any]:
    if not Path(path).exists():
        return {}
    with open(path, "rb") as file:
        result, results = pickle.load(file)
    # Results of another function under the same path would be taken for this one's.
    if result != owner:
        raise invalid("saved", f"a file of {result}", f"one of {owner}, or a new one")
    return results


def _write(path: str | Path, owner: str, done: Mapping[str, Any]) -> None:
    """Write the whole file at once: an interruption leaves the old one as it was."""
    beside = Path(f"{path}.{os.getpid()}")
    # Write a neighbour and rename it: a rename is atomic.
    beside.write_bytes(pickle.dumps((owner, done)))
    os.replace(beside, path)


def _report_progress(done: int, jobs: int) -> None:
    # A notebook would show the line on a red ground, like a warning.
    quiet = os.environ.get("COURSE_QUIET") == "1" or not sys.stderr.isatty()
    if not quiet and 10 * done // jobs > 10 * (done - 1) // jobs:
        print(f"{done} of {jobs} jobs", file=sys.stderr)
