"""Reading a submission as text, whatever the file turns out to be."""

from __future__ import annotations

import codecs
import errno
import os
import re
import stat

SIZE = 1_000_000  # bytes
COOKIE = re.compile(rb"^[ \t\f]*#.*?coding[:=][ \t]*([-\w.]+)")

KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFLNK: "a symbolic link",
}


class Unreadable(Exception):
    """The submission is not readable as Python source; `sentence` says why."""

    def __init__(self, sentence: str) -> None:
        super().__init__(sentence)
        self.sentence = sentence


def read_submission(path: str | os.PathLike[str]) -> str:
    """Return the text of a submission's file.

    No link is followed at the file itself, nothing but a regular file is opened, and opening never
    waits.

    Args:
        path: the file.

    Returns:
        The text, without a byte order mark.

    Raises:
        Unreadable: when it is missing, not a regular file, too large, or not UTF-8.
    """
    name = os.path.basename(os.fspath(path)) or os.fspath(path)
    try:
        # Without O_NONBLOCK, opening a named pipe would wait for somebody to write.
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.EMLINK) and os.path.islink(path):
            sentence = f"{name} is a symbolic link. Give the file itself."
        elif error.errno == errno.ENOENT:
            sentence = f"There is no file {name}."
        elif error.errno in (errno.ENXIO, errno.EOPNOTSUPP):
            sentence = f"{name} is a socket or a device, not a file of Python source."
        elif error.errno == errno.ELOOP:
            sentence = f"The path to {name} holds a circle of symbolic links."
        else:
            sentence = f"{name} can't be opened: {error.strerror}."
        raise Unreadable(sentence) from error
    except ValueError as error:
        raise Unreadable("The path holds a NUL character.") from error
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            kind = KINDS.get(stat.S_IFMT(status.st_mode), "not a regular file")
            raise Unreadable(f"{name} is {kind}, not a file of Python source.")
        if status.st_size > SIZE:
            raise Unreadable(
                f"{name} has {status.st_size / 1e6:.1f} MB; an answer may have {SIZE / 1e6:.0f} MB."
            )
        data = b""
        while len(data) <= SIZE:
            part = os.read(handle, SIZE + 1 - len(data))
            if not part:
                break
            data += part
    except OSError as error:
        raise Unreadable(f"{name} can't be read: {error.strerror}.") from error
    finally:
        os.close(handle)
    return decode_submission(data)


def decode_submission(data: bytes) -> str:
    """Return the text of a submission's bytes: strict UTF-8, with or without a byte order mark.

    Args:
        data: at most 1 MB.

    Raises:
        Unreadable: when it is larger, holds NUL, or is another encoding, which is named.
    """
    if len(data) > SIZE:
        raise Unreadable(f"The answer is larger than {SIZE / 1e6:.0f} MB.")
    for mark, encoding in (
        (codecs.BOM_UTF32_LE, "UTF-32"),
        (codecs.BOM_UTF32_BE, "UTF-32"),
        (codecs.BOM_UTF16_LE, "UTF-16"),
        (codecs.BOM_UTF16_BE, "UTF-16"),
    ):
        if data.startswith(mark):
            raise Unreadable(f"The file is {encoding}. Save it as UTF-8.")
    data = data.removeprefix(codecs.BOM_UTF8)
    for line in data.splitlines()[:2]:
        cookie = COOKIE.match(line)
        if cookie is None:
            continue
        name = cookie.group(1)[:40].decode("ascii", "replace")
        try:
            standard = codecs.lookup(name).name
        except LookupError:
            raise Unreadable(f"The coding line names {name}, which Python doesn't know.") from None
        if standard not in ("utf-8", "ascii", "utf-8-sig"):
            raise Unreadable(f"The coding line says {name}. Save the file as UTF-8, without it.")
    position = data.find(b"\0")
    if position >= 0:
        half = data[:4000].count(b"\0") * 3 > len(data[:4000])
        guess = " It looks like UTF-16: save it as UTF-8." if half else ""
        line_number = data.count(b"\n", 0, position) + 1
        raise Unreadable(f"The file holds a NUL byte in line {line_number}.{guess}")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        line_number = data.count(b"\n", 0, error.start) + 1
        raise Unreadable(
            f"Line {line_number} is not UTF-8 (byte 0x{data[error.start]:02x}); the file may be "
            f"Latin-1 or Windows-1252. Save it as UTF-8."
        ) from error
