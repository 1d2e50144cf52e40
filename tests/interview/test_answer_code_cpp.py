"""The C++ in the answers: compiled as it stands, and run by two threads under the sanitizer."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from course import interview
from course.middleware import controller
from tests import optional

MOST_LINES = 25
BLOCK = re.compile(r"^```cpp\n(.*?)^```$", re.S | re.M)
CODE = {
    f"{topic.name}/{q.name}": blocks
    for topic in interview.FOLDER.iterdir()
    for q in interview.questions(topic.name)
    if (blocks := BLOCK.findall(f"{q.minute}\n{q.full}"))
}

# A torn value has parts that do not belong together; an old one has a smaller count.
NEWEST = """
#include <cstdio>
#include <thread>
struct Value { long count = 0, twice = 0, parts[30] = {}; };
int main() {
    static Latest<Value> latest;
    Value none;
    if (latest.read(none)) return 1;  // nothing was written yet
    std::thread writer([] {
        for (long n = 1; n <= 50000; ++n) {
            Value v{n, 2 * n};
            for (long& part : v.parts) part = n;
            latest.write(v);
        }
    });
    long last = 0, fresh = 0;
    while (last < 50000) {
        Value v;
        const bool now = latest.read(v);
        if (v.twice != 2 * v.count || v.count < last || (now && v.count == last)) return 2;
        for (long part : v.parts) if (part != v.count) return 3;
        fresh += now;
        last = v.count;
    }
    writer.join();
    Value v;
    if (latest.read(v) || v.count != 50000) return 4;  // the newest stays, and is no longer new
    std::printf("%ld", fresh);
    return fresh > 0 ? 0 : 5;
}
"""
QUEUE = """
#include <cstdio>
#include <thread>
int main() {
    static Ring<long, 8> ring;
    long x = 0;
    if (ring.pop(x)) return 1;
    for (long n = 0; n < 8; ++n) if (!ring.push(n)) return 2;
    if (ring.push(8)) return 3;  // full
    for (long n = 0; n < 8; ++n) if (!ring.pop(x) || x != n) return 4;
    std::thread writer([] { for (long n = 0; n < 50000;) if (ring.push(n)) ++n; });
    for (long n = 0; n < 50000;) if (ring.pop(x)) { if (x != n) return 5; ++n; }
    writer.join();
    if (ring.pop(x)) return 6;
    std::printf("1");
    return 0;
}
"""
DRIVERS = {"middleware/newest_value_without_a_lock": NEWEST, "middleware/ring_buffer": QUEUE}


def outcome(source: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Compile a program with the thread sanitizer and run it."""
    (folder / "answer.cpp").write_text(source, encoding="utf-8")
    compiler = controller.compiler()
    if compiler is None:
        optional.skip(f"the C++ of the answers did NOT run: {controller.NO_COMPILER}")
    flags = "-std=c++17 -O2 -g -pthread -Wall -Wextra -Werror -fsanitize=thread".split()
    built = subprocess.run(
        [compiler, *flags, "answer.cpp", "-o", "answer"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert built.returncode == 0, built.stderr
    # The sanitizer needs the addresses where it expects them; newer kernels shuffle them farther.
    command = [*(["setarch", "-R"] if shutil.which("setarch") else []), "./answer"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


def test_every_code_has_its_driver() -> None:
    assert CODE.keys() == DRIVERS.keys()


@pytest.mark.parametrize("name", CODE)
def test_the_code_is_short_and_no_line_is_cut_on_a_page(name: str) -> None:
    for block in CODE[name]:
        lines = [line for line in block.splitlines() if line.strip()]
        assert len(lines) <= MOST_LINES
        assert max(map(len, lines)) <= 100


@pytest.mark.prove
@pytest.mark.parametrize("name", CODE)
def test_two_threads_lose_and_tear_nothing(name: str, tmp_path: Path) -> None:
    done = outcome("\n".join(CODE[name]) + DRIVERS[name], tmp_path)
    assert (done.returncode, done.stderr) == (0, ""), (done.returncode, done.stderr[:2000])


@pytest.mark.slow
def test_a_race_would_be_seen(tmp_path: Path) -> None:
    name = "middleware/newest_value_without_a_lock"
    right = "\n".join(CODE[name]) + DRIVERS[name]
    wrong = right.replace("std::memory_order_acq_rel", "std::memory_order_relaxed")
    assert wrong != right
    assert "data race" in outcome(wrong, tmp_path).stderr
