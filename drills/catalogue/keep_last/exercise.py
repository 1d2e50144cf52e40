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
        log("no messages", "edge", n=0, slow=1.0),
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
        "A full cache refuses what comes. It keeps the last: what arrived first is pushed out.",
    ),
    age_from_reception=(
        _ENDS,
        "times + (lifespan if lifespan > 0.0 else np.inf)",
        "The age counts from the arrival. A message is as old as its stamp says: what the link "
        "took is part of its life.",
    ),
    none_taken_as_zero=(
        _ENDS,
        "np.asarray(stamps, dtype=float) + lifespan",
        "With a lifespan of 0 everything is gone at once. It stands for none.",
    ),
    lifespan_forgotten=(
        _ENDS,
        "np.full(len(times), np.inf)",
        "The lifespan does nothing: old messages are handed out.",
    ),
    gone_only_at_reading=(
        _FREED,
        "",
        "if at < ends[came]:",
        "if True:",
        "What is too old is thrown out only when somebody reads. Until then it takes the place of "
        "others that are fresh.",
    ),
    gone_keeps_its_place=(
        _FREED,
        "",
        "What is too old still has its place when the next one arrives: it counts as dropped, or a "
        "fresh one before it is pushed out. The place is free at once.",
    ),
    gone_on_arrival_taken_in=(
        "if at < ends[came]:",
        "if True:",
        "A message that is too old when it arrives is taken in, and pushes out a fresh one.",
    ),
    old_is_handed_out=(
        _FRESH,
        "",
        "What has grown too old since the last arrival is handed out. Look at the ages again when "
        "somebody reads.",
    ),
    not_emptied=(
        _EMPTY,
        "cache",
        "The cache is not emptied: the next read takes the same messages again.",
    ),
    newest_first=(
        "= cache\n",
        "= cache[::-1]\n",
        "The newest comes first. A read takes them in the order of arrival.",
    ),
    by_stamp=(
        "= cache\n",
        "= sorted(cache, key=lambda k: ends[k])\n",
        "The messages are sorted by their stamps. They come in the order of arrival.",
    ),
    strictly_before=(
        "times[came] <= now",
        "times[came] < now",
        "A message that arrives at the moment of reading is left for the next one.",
    ),
    one_too_many=(
        "len(cache) == depth",
        "len(cache) == max(depth - 1, 1)",
        "The cache holds one less than its depth.",
    ),
    gone_counted=(
        "    came += 1\n        cache = [k for k in cache if now < ends[k]]",
        "    came += 1\n        dropped += sum(now >= ends[k] for k in cache)\n"
        "        cache = [k for k in cache if now < ends[k]]",
        "What grew too old is counted as dropped. Only those pushed out of a full cache are.",
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
