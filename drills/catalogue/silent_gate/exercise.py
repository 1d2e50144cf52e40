"""The silent-bug hunt of chapter 12: nights as the author looked at, then as nights are."""

import numpy as np

from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return two nights.

    Orders, crashes, retries and scenarios of one night alone, then all of them.
    """

    def nights(
        label: str,
        level: str = "core",
        *,
        n: int = 60,
        shuffled: bool = False,
        crashes: float = 0.0,
        retries: bool = False,
        other: int = 0,
        share: float = 0.7,
        gate: float = -1.0,
    ) -> Case:
        names = rng.permutation(1000)[: n + other]

        def night(own: np.ndarray, good: float) -> tuple[np.ndarray, np.ndarray]:
            own = rng.permutation(own) if shuffled else own
            values = np.where(rng.random(n) < good, 1, -(rng.random(n) < crashes).astype(int))
            if retries:  # most of what didn't work once more, and again
                for _ in range(2):
                    again = rng.permutation(own[values < 1])[:20]
                    own = np.append(own, again)
                    values = np.append(values, rng.integers(-1, 2, len(again)))
            return own, values

        limit = float(rng.uniform(0.3, 0.9)) if gate < 0.0 else gate
        both = *night(names[:n], share), *night(names[other:], share - 0.1)
        return Case((*both, limit), label, level)

    return [
        nights("as its author looked", "simple", n=100),
        nights("a small night", "simple", n=5),
        nights("a gate that is low", "simple", gate=0.1),
        *(nights("other orders", shuffled=True) for _ in range(2)),
        *(nights("crashes", crashes=0.6) for _ in range(2)),
        *(nights("retries", retries=True) for _ in range(2)),
        nights("scenarios of one night", other=15),
        nights("all, a low gate", shuffled=True, crashes=0.5, retries=True, other=8, gate=0.15),
        *(nights("all", shuffled=True, crashes=0.5, retries=True, other=8) for _ in range(3)),
        *(nights("between rate and end", n=30, gate=0.68) for _ in range(4)),
        nights("all worked", "edge", share=2.0, gate=0.9),
        nights("one run", "edge", n=1),
        nights("none worked", "edge", share=-1.0, crashes=0.5),
    ]


_FIRST, _CRASH = "table.setdefault(int(name), bool(result == 1))", "bool(result == 1)"
_BOTH = "both = [(new[seed], old[seed]) for seed in new if seed in old]"
_ROWS = "both = list(zip(new.values(), old.values()))"
_LOOP = f"            {_FIRST}\n"
_LAST = "            table[int(name)] = bool(result == 1)\n"
_DROPPED = (
    "            if result >= 0:\n                table.setdefault(int(name), bool(result))\n"
)
_DROPPED_LAST = "            if result >= 0:\n                table[int(name)] = bool(result)\n"

SLIPS = slips(
    all_still_there=(_LOOP, _DROPPED_LAST, _BOTH, _ROWS, "All three are still there."),
    crashes_dropped=(
        _LOOP,
        _DROPPED,
        "Runs that crashed are left out of the count. They were tried, and did not work: what is "
        "left out decides the rate.",
    ),
    last_run_counts=(
        _LOOP,
        _LAST,
        "A retry replaces the run before it. With enough of them everything passes: the first run "
        "counts.",
    ),
    paired_by_row=(
        _BOTH,
        _ROWS,
        "The nights are paired row by row. Each has its own order and may have scenarios of its "
        "own: pair by seed.",
    ),
    crashes_and_rows=(
        _LOOP,
        _DROPPED,
        _BOTH,
        _ROWS,
        "The retries are mended. Crashes are still left out, and the nights are paired by row.",
    ),
    retries_and_rows=(
        _LOOP,
        _LAST,
        _BOTH,
        _ROWS,
        "The crashes are mended. Retries still count, and the nights are paired by row.",
    ),
    crashes_and_retries=(
        _LOOP,
        _DROPPED_LAST,
        "The pairs are mended. Crashes are still left out, and retries still count.",
    ),
    every_run_a_trial=(
        "n, square = len(new),",
        "n, square = len(np.asarray(seeds)),",
        "p = sum(new.values()) / n",
        "p = np.mean(np.asarray(outcomes) == 1)",
        "Each run is taken for a trial: a scenario that was run four times counts four times.",
    ),
    retries_in_the_trials=(
        "n, square = len(new),",
        "n, square = len(np.asarray(seeds)),",
        "The number of trials counts retries, and the successes do not. Divide the successful "
        "scenarios by the number of scenarios.",
    ),
    best_run_counts=(
        _FIRST,
        "table[int(name)] = table.get(int(name), False) or bool(result == 1)",
        "A scenario counts as solved if any of its runs was. Only the first run counts: a real "
        "robot gets no second attempt.",
    ),
    crash_is_true=(_CRASH, "bool(result)", "A crash counts as a success: -1 is true."),
    the_rate_at_the_gate=(
        "int(low >= gate)",
        "int(p >= gate)",
        "The rate itself is held against the gate. A few lucky runs open it: the lower end has to "
        "reach it.",
    ),
    missing_is_failed=(
        _BOTH,
        "both = [(new.get(s, False), old.get(s, False)) for s in {**new, **old}]",
        "A scenario that one night lacks counts as failed there. It is in no pair.",
    ),
    tally_turned=(
        "np.array([both.count((True, False)), both.count((False, True))])",
        "np.array([both.count((False, True)), both.count((True, False))])",
        "What was won and what was lost have changed places: first come those that only the new "
        "version solves.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "a root and counts: rounding", explain=coarse),
    examples=(
        "silent_gate([1, 2, 3, 4], [1, 1, 1, 0], [1, 2, 3, 4], [1, 0, 1, 1], 0.25)",
        "silent_gate([1, 2, 3, 2], [1, -1, 1, 1], [3, 2, 1], [1, 1, 0], 0.25)",
    ),
    slips=SLIPS
    + coarse_slips("silent_gate", "A gate is decided by the digits of the end.")
    + value_slips("silent_gate", whole=False),
)
