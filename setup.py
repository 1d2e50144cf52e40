"""What pyproject.toml cannot say: of one commit the sdist is always the same, as the wheel is.

Setuptools writes the wheel with the time stamps of SOURCE_DATE_EPOCH, the sdist with those of the
files, their owner, and the clock.
"""

import gzip
import os
import tarfile
import time
from pathlib import Path
from typing import Any

from setuptools import setup
from setuptools.command.sdist import sdist


class Sdist(sdist):
    def make_archive(
        self, base_name: str, format: str, root_dir: Any = None, base_dir: Any = None, **owner: Any
    ) -> str:
        stamp = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))

        def settled(member: tarfile.TarInfo) -> tarfile.TarInfo:
            member.mtime, member.mode = stamp, 0o755 if member.mode & 0o100 else 0o644
            member.uid = member.gid = 0
            member.uname = member.gname = ""
            return member

        path = Path(f"{base_name}.tar.gz")
        with (
            path.open("wb") as file,
            gzip.GzipFile("", "wb", fileobj=file, mtime=stamp) as packed,
            tarfile.open(fileobj=packed, mode="w") as archive,
        ):
            archive.add(base_dir, filter=settled)
        return str(path)


setup(cmdclass={"sdist": Sdist})
