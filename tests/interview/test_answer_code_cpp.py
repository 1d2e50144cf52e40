"""The C++ in the answers: compiled as it stands, and run under the sanitizers.

Threads run under the thread sanitizer, everything else under that for undefined behaviour, with
that for addresses where it can be. Each driver returns 0, or the number of the check that failed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
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
# The reader may only see the table as it was before the flag was set.
FLAG = """
#include <array>
#include <thread>
int main() {
    for (long round = 1; round <= 200; ++round) {
        Published<std::array<long, 40>> table;
        if (table.get()) return 1;
        std::thread writer([&] {
            std::array<long, 40> values;
            values.fill(round);
            table.publish(values);
        });
        const std::array<long, 40>* seen = nullptr;
        while (!(seen = table.get())) std::this_thread::yield();
        for (long value : *seen) if (value != round) return 2;
        writer.join();
        if (table.get() != seen) return 3;
    }
}
"""
# The lines are those of this machine, as far as it tells their size.
LINES = """
#include <cstdint>
#include <thread>
#include <unistd.h>
template <class C> bool one_line(const C& c, std::uintptr_t line) {
    return reinterpret_cast<std::uintptr_t>(&c.first) / line
        == reinterpret_cast<std::uintptr_t>(&c.second) / line;
}
template <class C> bool counts(C& c, long n) {
    std::thread one([&] { count(c.first, n); }), other([&] { count(c.second, 2 * n); });
    one.join();
    other.join();
    return c.first == n && c.second == 2 * n;
}
int main() {
    static Together together[3];
    static Apart apart[3];
    if (sizeof(Together) != APART || sizeof(Apart) != 2 * APART) return 3;
#ifdef _SC_LEVEL1_DCACHE_LINESIZE
    const long told = sysconf(_SC_LEVEL1_DCACHE_LINESIZE);
#else
    const long told = 0;
#endif
    const std::uintptr_t line = told > 0 ? told : 64;
    for (int i = 0; i < 3; ++i)
        if (!one_line(together[i], line) || one_line(apart[i], line)) return 1;
    return counts(together[1], 20000) && counts(apart[1], 20000) ? 0 : 2;
}
"""
# A vector shows by its capacity when it allocates; the counter has to agree with it. The sanitizer
# for addresses replaces the function for arrays, which then no longer calls the answer's.
COUNTED = """
#include <memory>
#include <string>
#include <thread>
#include <vector>
int main() {
    std::vector<int> grown;
    long changes = 0;
    const long seen = allocations_in([&] {
        const auto before = grown.capacity();
        grown.push_back(1);
        changes += grown.capacity() != before;
    }, 1000);
    if (seen != changes || changes < 2) return 1;
    std::vector<int> reserved;
    reserved.reserve(1000);
    if (allocations_in([&] { reserved.push_back(1); }, 1000) != 0) return 2;
    std::vector<std::unique_ptr<long[]>> arrays(10);
    std::size_t i = 0;
    if (allocations_in([&] { arrays[i++].reset(new long[100]); }, 10) != 10) return 3;
    std::string text;
    const char* longer = "too long for the characters that a string holds inside";
    if (allocations_in([&] { text = longer; }, 5) != 1) return 4;
    // Another thread's allocations are not this loop's.
    std::vector<int> other;
    const long own = allocations_in([&] { std::thread([&] { other.resize(99); }).join(); }, 1);
    return own == allocations_in([] { std::thread([] {}).join(); }, 1) ? 0 : 5;
}
"""
# Whether the deleter counts depends only on who is last.
WATCHED = """
#include <vector>
int main() {
    std::atomic<long> by_control{0};
    const auto control = std::this_thread::get_id();
    auto image = watched(std::vector<char>(1000), control, by_control);
    std::weak_ptr<std::vector<char>> seen = image;
    std::thread([last = std::move(image)]() mutable { last.reset(); }).join();
    if (!seen.expired() || by_control != 0) return 1;
    image = watched(std::vector<char>(10, 'a'), control, by_control);
    std::thread([copy = image]() mutable { copy.reset(); }).join();
    if (by_control != 0 || image->back() != 'a') return 2;
    image.reset();
    return by_control == 1 ? 0 : 3;
}
"""
# The kernel says which descriptors are open.
OWNED = """
#include <type_traits>
#include <vector>
bool open_now(int fd) { return ::fcntl(fd, F_GETFD) != -1; }
static_assert(!std::is_copy_constructible_v<Device> && !std::is_assignable_v<Device&, Device&>);
static_assert(std::is_nothrow_move_constructible_v<Device>);
static_assert(std::is_nothrow_move_assignable_v<Device>);
int main() {
    const char* path = "/dev/null";
    int number = -1;
    {
        Device first(path);
        number = first.get();
        if (!open_now(number)) return 1;
        Device second(std::move(first));
        if (first.get() != -1 || second.get() != number || !open_now(number)) return 2;
    }
    if (open_now(number)) return 3;
    {   // The number of a device that was closed goes to somebody else, who has to keep it.
        auto* first = new Device(path);
        number = first->get();
        { const Device second(std::move(*first)); }
        if (open_now(number)) return 4;
        const Device other(path);
        if (other.get() != number) return 5;
        delete first;
        if (!open_now(number)) return 6;
    }
    {
        Device one(path), two(path);
        const int lost = one.get(), kept = two.get();
        one = std::move(two);
        if (open_now(lost) || !open_now(kept) || one.get() != kept || two.get() != -1) return 7;
        Device& same = one;
        one = std::move(same);
        if (one.get() != kept || !open_now(kept)) return 8;
        two = Device(path);
        if (!open_now(two.get()) || two.get() == kept) return 9;
    }
    try {
        const Device good(path);
        number = good.get();
        const Device bad("/no such device");
        return 10;
    } catch (const std::system_error& error) {
        if (error.code().value() != ENOENT || open_now(number)) return 11;
    }
    std::vector<Device> many;
    std::vector<int> numbers;
    for (int i = 0; i < 50; ++i) numbers.push_back(many.emplace_back(path).get());
    for (int fd : numbers) if (!open_now(fd)) return 12;
    many.clear();
    for (int fd : numbers) if (open_now(fd)) return 13;
    return 0;
}
"""
# Next to a set of what is lent, with the allocations counted.
LENT = """
#include <cstdlib>
#include <new>
#include <random>
#include <set>
#include <utility>
static long allocated = 0;
[[gnu::noinline]] void* operator new(std::size_t size) {
    ++allocated;
    if (void* block = std::malloc(size)) return block;
    throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* block) noexcept { std::free(block); }
[[gnu::noinline]] void operator delete(void* block, std::size_t) noexcept { std::free(block); }
int main() {
    using Buffer = std::array<double, 16>;
    static Pool<Buffer, 5> pool;
    static_assert(!std::is_copy_constructible_v<decltype(pool)>);
    static_assert(!std::is_move_constructible_v<decltype(pool)>);
    std::array<Pool<Buffer, 5>::Lent, 9> held;
    std::set<Buffer*> lent;
    std::mt19937 random(1);
    long empty = 0;
    for (long step = 0; step < 20000; ++step) {
        auto& one = held[random() % held.size()];
        if (one) {
            for (double x : *one) if (x != one->front()) return 1;  // nobody else wrote to it
            if (lent.erase(one.get()) != 1) return 2;
            const long before = allocated;
            if (step % 2) one.reset();
            else { const auto gone = std::move(one); }
            if (one || allocated != before) return 3;
        } else {
            const long before = allocated;
            one = pool.take();
            if (allocated != before) return 4;
            if (bool(one) != (lent.size() < 5)) return 5;
            if (!one) { ++empty; continue; }
            if (!lent.insert(one.get()).second) return 6;  // lent twice
            one->fill(double(step));
        }
    }
    return empty > 100 ? 0 : 7;
}
"""


@dataclass(frozen=True)
class Driver:
    """A program that uses the code of an answer.

    Attributes:
        main: the program.
        right, wrong: words of the code, and a fault that the program has to notice.
        sanitizer: which the compiler adds.
        report: words of what the sanitizer then reports; if empty, the program returns not 0.
    """

    main: str
    right: str
    wrong: str
    sanitizer: str = "thread"
    report: str = ""


MEMORY = "address,undefined"
DRIVERS = {
    "middleware/newest_value_without_a_lock": Driver(
        NEWEST, "memory_order_acq_rel", "memory_order_relaxed", report="data race"
    ),
    "middleware/ring_buffer": Driver(
        QUEUE, "std::memory_order_release", "std::memory_order_relaxed", report="data race"
    ),
    "middleware/flag_and_data": Driver(
        FLAG, "std::memory_order_release", "std::memory_order_relaxed", report="data race"
    ),
    "middleware/false_sharing": Driver(
        LINES, "    alignas(APART) std::atomic<long> second", "    std::atomic<long> second"
    ),
    "middleware/forbidden_in_the_loop": Driver(COUNTED, "thread_local", "static", "undefined"),
    "middleware/who_frees_it": Driver(WATCHED, "== control", "!= control"),
    "middleware/device_handle": Driver(OWNED, "std::exchange(other.fd, -1)", "other.fd", MEMORY),
    "middleware/pool_of_buffers": Driver(LENT, "[--left]", "[left - 1]", MEMORY),
}


def outcome(
    source: str, folder: Path, sanitizer: str = "thread"
) -> subprocess.CompletedProcess[str]:
    """Compile a program with a sanitizer and run it."""
    (folder / "answer.cpp").write_text(source, encoding="utf-8")
    compiler = controller.compiler()
    if compiler is None:
        optional.skip(f"the C++ of the answers did NOT run: {controller.NO_COMPILER}")
    flags = "-std=c++17 -O2 -g -pthread -Wall -Wextra -Werror".split()
    built = subprocess.run(
        [compiler, *flags, f"-fsanitize={sanitizer}", "answer.cpp", "-o", "answer"],
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
def test_the_code_does_what_the_answer_says(name: str, tmp_path: Path) -> None:
    driver = DRIVERS[name]
    done = outcome("\n".join(CODE[name]) + driver.main, tmp_path, driver.sanitizer)
    assert (done.returncode, done.stderr) == (0, ""), (done.returncode, done.stderr[:2000])


@pytest.mark.prove
@pytest.mark.parametrize("name", CODE)
def test_a_fault_in_the_code_is_noticed(name: str, tmp_path: Path) -> None:
    driver, right = DRIVERS[name], "\n".join(CODE[name])
    wrong = right.replace(driver.right, driver.wrong)
    assert wrong != right
    done = outcome(wrong + driver.main, tmp_path, driver.sanitizer)
    assert done.returncode != 0 and driver.report in done.stderr


@pytest.mark.slow
def test_a_race_would_be_seen(tmp_path: Path) -> None:
    test_a_fault_in_the_code_is_noticed("middleware/newest_value_without_a_lock", tmp_path)
