"""The environment of the tests, what each topic costs, and which tests a topic has.

Tests in a browser run where there is one, and say so if not. `--topic contact` runs the tests of
one topic and the smoke tests of the framework: a test belongs to the folder it stands in; one over
all chapters to the chapter of its parameter, or to what `pytest.mark.topic("contact")` names.
`--quick` leaves out what takes long (tests/budget.py says which, and what the smoke tests are).
COURSE_PROVE=1 runs the long tier instead: what stands in `tests/prove`, and every property with
many examples, drawn afresh.
"""

import importlib.util
import os
import shutil
from collections import defaultdict
from pathlib import Path

import hypothesis
import pytest

from tests.budget import (
    CHAPTER,
    PROVE,
    QUICK_SECONDS,
    ROOT,
    SPREAD,
    TOPICS,
    is_quick,
    is_smoke,
    processor_time,
    seconds_allowed,
    slowness,
    too_costly,
    topic_of,
    working_time,
    yardstick,
)

# Small matrices are slower with threads, and threads that wait for each other use processor time.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# A learner's own settings are not for the tests, which make work folders of their own.
for _name in [name for name in os.environ if name.startswith("DRILLS_")]:
    del os.environ[_name]

# `make test` draws the same examples every time; `make prove` draws new ones.
hypothesis.settings.register_profile("test", derandomize=True, deadline=None, database=None)
hypothesis.settings.register_profile("prove", deadline=None, print_blob=True)
hypothesis.settings.load_profile("prove" if PROVE else "test")

# --- Topics, and what they cost -------------------------------------------------------------------

_SECONDS: defaultdict[str, float] = defaultdict(float)
_YARDSTICKS: list[float] = []  # taken now and then, as the machine's pace changes


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--topic", help="run the tests of this topic, and the smoke tests")
    parser.addoption("--quick", action="store_true", help="leave out what takes long")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "topic(name): what a test over all chapters counts for")
    config.addinivalue_line("markers", "optional: needs a library that make test does not install")


def _topic(item: pytest.Item) -> str:
    marker = item.get_closest_marker("topic")
    if marker:
        return marker.args[0]
    # A claim, a card, a question: a test over all of them counts for the chapter of each.
    drawn = getattr(item, "callspec", None)
    for value in drawn.params.values() if drawn else ():
        if isinstance(getattr(value, "chapter", None), int):
            return CHAPTER[value.chapter]
    return topic_of(item.path.relative_to(ROOT).as_posix())


def _is_long(item: pytest.Item) -> bool:
    return item.path.is_relative_to(ROOT / "tests" / "prove")


def _is_property(item: pytest.Item) -> bool:
    return hypothesis.is_hypothesis_test(getattr(item, "obj", None))


def _full_name(item: pytest.Item) -> str:
    return f"{item.path.relative_to(ROOT).as_posix()}::{item.nodeid.partition('::')[2]}"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    wanted, kept = config.getoption("--topic"), items
    if PROVE:
        kept = [item for item in kept if _is_long(item) or _is_property(item)]
    if config.getoption("--quick"):
        kept = [item for item in kept if is_quick(_full_name(item))]
    if wanted:
        rooms = sorted({*TOPICS, *map(_topic, items)})
        if wanted not in rooms:
            raise pytest.UsageError(f"topic is {wanted!r}, allowed is {', '.join(rooms)}")
        kept = [item for item in kept if _topic(item) == wanted or is_smoke(_full_name(item))]
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = kept


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None):
    start = processor_time()
    if start > 10.0 * len(_YARDSTICKS):
        _YARDSTICKS.append(yardstick())
    start = working_time()
    try:
        return (yield)
    finally:
        _SECONDS[_topic(item)] += working_time() - start


def pytest_sessionfinish(session: pytest.Session) -> None:
    # A worker of pytest-xdist tells the run that it works for.
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["seconds"] = dict(_SECONDS)
        session.config.workeroutput["yardsticks"] = _YARDSTICKS
        return
    slow = slowness(_YARDSTICKS)
    costly = too_costly(_SECONDS, slow)
    quick = sum(_SECONDS.values()) if session.config.getoption("--quick") else 0.0
    if quick > SPREAD * slow * QUICK_SECONDS:
        costly.append("the quick tests")
    # Processor time grows too where more wants to run than there are cores: then it only tells.
    quiet = os.getloadavg()[0] < 1.5 * (os.cpu_count() or 1) + 1.0
    if costly and quiet and not PROVE:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node, error) -> None:
    for topic, spent in getattr(node, "workeroutput", {}).get("seconds", {}).items():
        _SECONDS[topic] += spent
    _YARDSTICKS.extend(getattr(node, "workeroutput", {}).get("yardsticks", ()))


# --- The browser ----------------------------------------------------------------------------------


def chromium() -> str | None:
    """The path of a Chromium, from COURSE_CHROMIUM or the usual names."""
    names = [os.environ.get("COURSE_CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome"]
    return next((path for name in names if name and (path := shutil.which(name))), None)


def why_no_browser() -> str:
    """What the browser test lacks, or nothing."""
    if importlib.util.find_spec("playwright") is None:
        return "the package playwright is not installed"
    return "" if chromium() else "Chromium not found"


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    if collection_path == ROOT / "tests" / "prove" and not PROVE:
        return True
    # A run that names the file itself is not asked: there a missing browser fails.
    required = os.environ.get("COURSE_REQUIRE_BROWSER") == "1"
    if collection_path.name == "test_browser.py" and why_no_browser() and not required:
        return True
    return None


def pytest_terminal_summary(terminalreporter) -> None:
    if sum(_SECONDS.values()) > 10.0:
        slow = slowness(_YARDSTICKS)
        title = f"processor time by topic, on a machine {slow:.1f} times as slow"
        terminalreporter.write_sep("-", title)
        for topic, spent in sorted(_SECONDS.items(), key=lambda entry: -entry[1]):
            allowed = seconds_allowed(topic)
            told = f"{topic:<14} {spent:6.1f} s of {allowed:g}"
            costly = topic in too_costly(_SECONDS, slow)
            told += f", fails: above {SPREAD * slow:.1f} times" if costly else ""
            terminalreporter.write_line(told, red=spent > slow * allowed)
        if terminalreporter.config.getoption("--quick"):
            told = f"{'quick tests':<14} {sum(_SECONDS.values()):6.1f} s of {QUICK_SECONDS:g}"
            terminalreporter.write_line(told, red=sum(_SECONDS.values()) > QUICK_SECONDS)
    reason = why_no_browser()
    if reason and os.environ.get("COURSE_REQUIRE_BROWSER") != "1":
        terminalreporter.write_line(f"browser test did NOT run: {reason}", yellow=True, bold=True)
