"""A small file of JSON that is the learner's own: read, changed and never lost.

It is written to a temporary name and then replaced, under a lock that the system drops when its
holder ends, however it ends. So a reader sees the old file or the new one, and two terminals at
once lose nothing. A corrupt file is moved aside, never overwritten.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

T = TypeVar("T")

_PATIENCE = 10.0  # s, for another terminal to finish its few milliseconds of work
_LARGEST = 4_000_000  # bytes; a real file has a few thousand


class Problem(Exception):
    """The file could not be read or written; the message is a sentence for the learner."""


class Damaged(Exception):
    """The file is there and is not what it should be."""


@dataclass(frozen=True)
class Form(Generic[T]):
    """What such a file holds.

    Attributes:
        schema: identifier in the file: a name, a slash, the version.
        called: how messages call it, as in "your progress".
        empty: makes what stands for a file that is not there.
        parse: makes it from the file's object; raises `Damaged`.
        plain: the object to write, which gets its schema here.
    """

    schema: str
    called: str
    empty: Callable[[], T]
    parse: Callable[[dict[str, Any]], T]
    plain: Callable[[T], dict[str, Any]]


def load(path: Path | None, form: Form[T]) -> tuple[T, tuple[str, ...]]:
    """Return the content of the file and a message; a damaged file is moved aside.

    Args:
        path: of the file, or None to keep nothing.
        form: of its content.
    """
    if path is None:
        return form.empty(), ()
    try:
        # Reading needs no lock: writers replace the file, so it is the old one or the new one.
        with contextlib.suppress(Damaged):
            return _read(path, form), ()
        # Read again under the lock, as another process may have moved the file aside meanwhile.
        with _locked(path, form.called):
            return _read_or_put_aside(path, form)
    except Problem as problem:
        return form.empty(), (str(problem),)


def change(
    path: Path | None, form: Form[T], edit: Callable[[T], object]
) -> tuple[T, tuple[str, ...]]:
    """Read, edit in place and write, under the lock.

    Returns:
        What the file holds now, and a notice if a damaged one was moved aside.

    Raises:
        Problem: if the file can't be written; it is then as it was.
    """
    if path is None:
        content = form.empty()
        edit(content)
        return content, ()
    with _locked(path, form.called):
        # Read under the lock, so that no change of another process is lost.
        content, notices = _read_or_put_aside(path, form)
        edit(content)
        _write(path, form, content)
    return content, notices


def _read(path: Path, form: Form[T]) -> T:
    failed = f"Your {form.called} in {path} can't be read"
    try:
        # Opening a named pipe would otherwise wait for somebody to write.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            regular = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
            # One byte more than allowed shows that it is too large.
            data = file.read(_LARGEST + 1) if regular else b""
    except FileNotFoundError:
        return form.empty()
    except OSError as error:
        raise Problem(f"{failed}: {_why(error)}.") from None
    if not regular:
        raise Problem(f"{failed}: it is not a file.")
    if len(data) > _LARGEST:
        raise Damaged
    try:
        content = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError):
        # Not JSON, or nested deeper than the parser can follow.
        raise Damaged from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(schema, str):
        raise Damaged
    if schema != form.schema:
        # Another version of this format is no damage: its own program can read it.
        if not schema.startswith(form.schema.partition("/")[0] + "/"):
            raise Damaged
        raise Problem(
            f"{path} was written by another version of this program ({schema}, here "
            f"{form.schema}), so it is left alone."
        )
    return form.parse(content)


def _read_or_put_aside(path: Path, form: Form[T]) -> tuple[T, tuple[str, ...]]:
    """Return under the lock: the content, or none after a damaged file was given another name."""
    with contextlib.suppress(Damaged):
        return _read(path, form), ()
    number = 1
    # The first free name, so that no earlier damaged file is overwritten.
    while os.path.lexists(aside := path.with_name(f"{path.name}.damaged-{number}")):
        number += 1
    try:
        os.rename(path, aside)
    except OSError as error:
        raise Problem(
            f"Your {form.called} in {path} is damaged and can't be put aside: {_why(error)}."
        ) from None
    notice = f"Your {form.called} file was damaged. It is kept as {aside}; a new one starts now."
    return form.empty(), (notice,)


def _write(path: Path, form: Form[T], content: T) -> None:
    whole = {"schema": form.schema, **form.plain(content)}
    text = json.dumps(whole, indent=2, ensure_ascii=False) + "\n"
    if len(text.encode("utf-8", "replace")) > _LARGEST:  # it could not be read again
        limit = f"{_LARGEST // 1_000_000} MB"
        raise Problem(f"Your {form.called} would be larger than {limit}: {path} stays as it was.")
    # A link is followed, so that the file it leads to is replaced and not the link.
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name}.part")
    try:
        # Only the holder of the lock writes: a part that is there was left by a killed process.
        with contextlib.suppress(FileNotFoundError):
            part.unlink()
        # Only a new file, and not through a link that somebody has put there.
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
        with os.fdopen(os.open(part, flags, 0o644), "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            # On the disk before the rename: else a power cut could leave an empty file under the
            # name.
            file.flush()
            os.fsync(file.fileno())
        # Atomic: a reader sees the old file or the new one.
        os.replace(part, target)
        _sync_folder(target.parent)
    except (KeyboardInterrupt, SystemExit):
        with contextlib.suppress(OSError):
            part.unlink()
        raise
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise Problem(f"Your {form.called} in {path} can't be written: {_why(error)}.") from None


def _sync_folder(folder: Path) -> None:
    """Make the new name last through a power cut, where the file system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def _locked(path: Path, called: str) -> Iterator[None]:
    """Hold the lock beside the file; the system drops it when this process ends."""
    import fcntl

    # A file of its own, as the file itself is replaced by every write.
    lock = path.with_name(f".{path.name}.lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise Problem(f"Your {called} in {path} can't be written: {_why(error)}.") from None
    try:
        deadline = time.monotonic() + _PATIENCE
        # Tried again and again without waiting, so that a stuck holder leads to a message.
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if error.errno in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
                    break  # a file system without locks: replacing is still atomic
                if error.errno not in (errno.EAGAIN, errno.EACCES, errno.EINTR):
                    raise Problem(
                        f"Your {called} in {path} can't be locked: {_why(error)}."
                    ) from None
            if time.monotonic() > deadline:
                raise Problem(
                    f"Another process has held the lock {lock} for {_PATIENCE:.0f} s, "
                    "so this was not recorded."
                )
            time.sleep(0.01)
        yield
    finally:
        # Closing the file drops the lock.
        os.close(handle)


def _why(error: OSError) -> str:
    return (error.strerror or type(error).__name__).lower()
