"""A cache of the last few: slow readers, then messages that grow old on the way and in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return messages about every 10 ms; readers as quick or up to eight times slower."""

    def log(
        label: str,
        level: str = "core",
        *,
        depth: int = 3,
        lifespan: float = 0.0,
        slow: float = 5.0,
        late: float = 0.002,
        n: int = 40,
    ) -> Case:
        stamps = 0.01 * (np.arange(n) + rng.uniform(0.0, 0.5, n))
        arrivals = stamps + rng.uniform(0.001, 0.001 + late, n)
        order = np.argsort(arrivals)  # what was long on its way is overtaken
        reads = 0.01 * slow * (np.arange(int(n / slow)) + rng.uniform(0.0, 0.3, int(n / slow)))
        return Case((stamps[order], arrivals[order], reads, depth, lifespan), label, level)

    times = np.arange(12)
    return [
        log("a quick reader", "simple", slow=0.8),
        log("a slow reader", "simple"),
        *(log("a slow reader, deep", depth=int(rng.integers(4, 9)), slow=8.0) for _ in range(2)),
        log("depth of one", depth=1),
        *(log("a lifespan", lifespan=0.02) for _ in range(2)),
        *(log("old on arrival", depth=1, lifespan=0.03, late=0.06) for _ in range(2)),
        *(log("old in the cache", depth=4, lifespan=0.05, late=0.05, slow=7.0) for _ in range(5)),
        log("all too old", "edge", lifespan=0.0005),
        # Two reads: without any, a list of rows is [] and has no shape (0, depth).
        Case((np.empty(0), np.empty(0), np.array([0.1, 0.2]), 3, 0.0), "no messages", "edge"),
        Case((times, times + 1, np.array([3, 4, 9, 13]), 3, 4), WHOLE, "edge"),
    ]


def at_reads(figure: Any, shown: Shown) -> None:
    """Plot which messages each read took."""
    axes = picture.plane(figure, "read", "number of the message")
    for (taken, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        rows, places = np.nonzero(np.asarray(taken) >= 0)
        axes.plot(rows, np.asarray(taken)[rows, places], "o", **style | {"ls": "-"})
    axes.legend()


_ENDS = "np.asarray(stamps, dtype=float) + (lifespan if lifespan > 0.0 else np.inf)"
_FREED = "            cache = [k for k in cache if at < ends[k]]\n"
_FULL = """                if len(cache) == depth:
                    cache.pop(0)
                    dropped += 1
                cache.append(came)
"""
_FRESH = "        cache = [k for k in cache if now < ends[k]]\n"
_EMPTY = "cache\n        cache = []"

SLIPS = slips(
    drops_the_newest=(
        _FULL,
        """                if len(cache) < depth:
                    cache.append(came)
                else:
                    dropped += 1
""",
        "A full queue rejects new messages. It must store the last ones: the message that arrived "
        "first is dropped.",
    ),
    age_from_reception=(
        _ENDS,
        "times + (lifespan if lifespan > 0.0 else np.inf)",
        "The age counts from the arrival. It must count from the stamp, so the time on the link "
        "is included.",
    ),
    none_taken_as_zero=(
        _ENDS,
        "np.asarray(stamps, dtype=float) + lifespan",
        "With a lifespan of 0 every message expires at once. A lifespan of 0 means none.",
    ),
    lifespan_forgotten=(
        _ENDS,
        "np.full(len(times), np.inf)",
        "The lifespan has no effect: expired messages are returned.",
    ),
    gone_only_at_reading=(
        _FREED,
        "",
        "if at < ends[came]:",
        "if True:",
        "Expired messages are removed only at a read. Until then they occupy places that fresh "
        "messages need.",
    ),
    gone_keeps_its_place=(
        _FREED,
        "",
        "An expired message still has its place when the next one arrives. Then it counts as "
        "dropped, or a fresh message is dropped. The place must be free at once.",
    ),
    gone_on_arrival_taken_in=(
        "if at < ends[came]:",
        "if True:",
        "A message that has expired when it arrives is stored, and a fresh one is dropped for it.",
    ),
    old_is_handed_out=(
        _FRESH,
        "",
        "Messages that have expired since the last arrival are returned. Check the ages again at "
        "each read.",
    ),
    not_emptied=(
        _EMPTY,
        "cache",
        "The queue is not emptied: the next read takes the same messages again.",
    ),
    newest_first=(
        "= cache\n",
        "= cache[::-1]\n",
        "The newest message comes first. A read must return them in the order of arrival.",
    ),
    by_stamp=(
        "= cache\n",
        "= sorted(cache, key=lambda k: ends[k])\n",
        "The messages are sorted by their stamps. They must be in the order of arrival.",
    ),
    strictly_before=(
        "times[came] <= now",
        "times[came] < now",
        "A message that arrives exactly at the time of a read is left for the next read. It must "
        "be taken.",
    ),
    one_too_many=(
        "len(cache) == depth",
        "len(cache) == max(depth - 1, 1)",
        "The queue holds one message less than its depth.",
    ),
    gone_counted=(
        "    came += 1\n        cache = [k for k in cache if now < ends[k]]",
        "    came += 1\n        dropped += sum(now >= ends[k] for k in cache)\n"
        "        cache = [k for k in cache if now < ends[k]]",
        "Expired messages count as dropped. Only messages that a full queue drops must count.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "whole numbers"),
    examples=(
        "keep_last([0, 1, 2, 3], [0.5, 1.5, 2.5, 3.5], [1.0, 4.0], 2, 0)",
        "keep_last([0, 1, 2, 3], [0.5, 1.5, 2.5, 3.5], [1.0, 4.0], 2, 1.5)",
    ),
    picture=at_reads,
    slips=SLIPS + value_slips("keep_last", whole=False),
)
