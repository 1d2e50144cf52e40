"""Fixed priorities on one core: which task sets are in time, by bound, by exact analysis, by run.

Arrays have a task per row, the highest priority first, and task sets in columns: shape (n,) or
(n, N). Rate-monotonic is: sorted by period. Times are whole nanoseconds inside.
Sources: C. L. Liu, J. W. Layland, Scheduling algorithms for multiprogramming in a hard-real-time
environment, JACM 20, 1973; J. Lehoczky, L. Sha, Y. Ding, The rate monotonic scheduling algorithm,
RTSS 1989; N. Audsley and others, Applying new scheduling theory to static priority pre-emptive
scheduling, 1993; L. Sha, R. Rajkumar, J. Lehoczky, Priority inheritance protocols, 1990; E. Bini,
G. Buttazzo, G. M. Buttazzo, A hyperbolic bound for the rate monotonic algorithm, 2001.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, one_of, positive, vector
from course.compiled import compiled

Array = NDArray[np.float64]
PROTOCOLS = ("none", "inheritance", "ceiling")
LATE = -1  # what is longer than a period
_TABLE = types.Array(numba.int64, 2, "C")


def liu_layland(n: int) -> float:
    """Return the utilization up to which n tasks meet their deadlines whatever their periods.

    It is n (2^(1/n) - 1), and tends to ln 2 (Liu and Layland, 1973).
    """
    return count("n", n, 1) * (2.0 ** (1.0 / n) - 1.0)


def utilization(execution: ArrayLike, period: ArrayLike) -> Array:
    """Sum of C / T over the tasks, shape () or (N,)."""
    C, T = _sets(execution, period)
    return np.asarray(np.sum(C / T, axis=0))


def hyperbolic(execution: ArrayLike, period: ArrayLike) -> NDArray[np.bool_]:
    """Return whether the product of (C / T + 1) is at most 2, the hyperbolic bound.

    Like Liu and Layland's bound it suffices, and more task sets meet it (Bini and Buttazzo, 2003).
    """
    C, T = _sets(execution, period)
    return np.asarray(np.prod(C / T + 1.0, axis=0) <= 2.0 + 1e-12)


def response_times(
    execution: ArrayLike, period: ArrayLike, blocking: ArrayLike = 0.0, jitter: ArrayLike = 0.0
) -> Array:
    """Return the longest response time of each task.

    R = J + w with the least w = C + B + the sum over all tasks above of ceil((w + J) / T) C
    (Audsley 1993); exact where all can be released at once.

    Args:
        execution: worst execution times C, highest priority first [s].
        period: periods T, same shape [s].
        blocking: B, longest wait for tasks below [s].
        jitter: J, by which a release may be late after its arrival [s].

    Returns:
        From arrival to end [s]; infinite where that is above the period, whose deadline it is.
    """
    C, T = _sets(execution, period)
    B, J = (_like(name, value, C) for name, value in (("blocking", blocking), ("jitter", jitter)))
    loop = compiled(_analyse, _TABLE(*[_TABLE] * 4))
    # In integer nanoseconds: a ceiling of rounded floats could be off by a whole period.
    result = loop(*(_whole(x) for x in (C, T, B, J))).reshape(C.shape)
    return np.asarray(np.where(result == LATE, np.inf, 1e-9 * result))


def _analyse(C, T, B, J):
    result = np.empty_like(C)
    for s in range(C.shape[1]):
        for i in range(C.shape[0]):
            w, more = 0, C[i, s] + B[i, s]
            # Fixed-point iteration from below: it reaches the least solution, the response time.
            while w < more <= T[i, s] - J[i, s]:
                w, more = more, C[i, s] + B[i, s]
                for j in range(i):
                    # Releases of task j in a window w with jitter: ceil((w + J) / T), in integers.
                    more += -((-w - J[j, s]) // T[j, s]) * C[j, s]
            result[i, s] = more + J[i, s] if more <= T[i, s] - J[i, s] else LATE
    return result


def breakdown(execution: ArrayLike, period: ArrayLike) -> Array:
    """Return the utilization at which a growing task set just meets its deadlines.

    All executions grow in proportion.

    Task i may grow to t / (sum of ceil(t / T) C) times its size at the best t, a multiple of its
    period or of one above (Lehoczky, Sha and Ding 1989); the least of all tasks counts.
    """
    C, T = _sets(execution, period)
    loop = compiled(_scale, types.Array(numba.float64, 1, "C")(_TABLE, _TABLE))
    scale = loop(_whole(C), _whole(T)).reshape(C.shape[1:])
    return np.asarray(scale * utilization(C, T))


def _scale(C, T):
    result = np.full(C.shape[1], np.inf)
    for s in range(C.shape[1]):
        for i in range(C.shape[0]):
            # Task i meets its deadline if its demand fits into the time at some scheduling point.
            best = 0.0
            for j in range(i + 1):
                # Scheduling points: the time demand changes only at multiples of the periods of
                # higher tasks (Lehoczky, Sha and Ding, 1989).
                for k in range(1, T[i, s] // T[j, s] + 1):
                    t, load = k * T[j, s], 0
                    for m in range(i + 1):
                        load += -(-t // T[m, s]) * C[m, s]
                    best = max(best, t / load)
            result[s] = min(result[s], best)
    return result


def blocking(section: ArrayLike, lock: ArrayLike, protocol: str) -> Array:
    """Return how long a task waits for tasks below, at most, shape (n,) [s].

    Args:
        section: how long each holds its lock [s].
        lock: number of its lock, shape (n,); below 0 for none.
        protocol: "ceiling": for one section, of a lock that it or a task above uses. "inheritance":
            for one of each such lock. "none": without end, but for the first task where only the
            second has its lock.
    """
    one_of("protocol", protocol, PROTOCOLS)
    S, L = vector("section", section, (None,), low=0.0), np.asarray(lock)
    result = np.zeros(S.size)
    for i in range(S.size):
        below = [j for j in range(i + 1, S.size) if L[j] >= 0 and L[j] in L[: i + 1] and S[j] > 0.0]
        if protocol == "none" and below not in ([], [1]):
            # A task of middle priority can then preempt the holder for as long as it likes.
            result[i] = np.inf
        elif protocol == "inheritance":
            locks = {int(L[j]) for j in below}
            # Inheritance: at most one section for each lock (Sha, Rajkumar and Lehoczky, 1990).
            result[i] = sum(max(S[j] for j in below if L[j] == k) for k in locks)
        else:
            # Ceiling: one section at most, as a second lock could not have been taken below it.
            result[i] = max((S[j] for j in below), default=0.0)
    return result


class Outcome(NamedTuple):
    """What a run showed of each task.

    Longest response [s], jobs that ended, and jobs that ended after their period, or not in the run
    though it was over; each of the shape of the sets.
    """

    longest: Array
    jobs: NDArray[np.int64]
    late: NDArray[np.int64]


def run(
    execution: ArrayLike,
    period: ArrayLike,
    seconds: float,
    phase: ArrayLike = 0.0,
    jitter: ArrayLike = 0.0,
    before: ArrayLike = 0.0,
    section: ArrayLike = 0.0,
    lock: ArrayLike = -1,
    protocol: str = "none",
) -> Outcome:
    """Let a preemptive scheduler of fixed priorities run task sets, from event to event.

    Args:
        execution: C of each task, highest priority first [s].
        period: T of each task [s].
        seconds: simulated time [s].
        phase: of the first arrival [s].
        jitter: by which the first job, and no other, is released late [s].
        before: own execution time after which a job takes its lock [s].
        section: execution time for which it holds the lock [s].
        lock: number of the lock, below 0 for none.
        protocol: "none": a holder keeps its priority. "inheritance": it runs with the priority of
            the highest task that waits for it. "ceiling": once it holds the lock it has the
            priority of the highest task that uses that lock.
    """
    C, T = _sets(execution, period)
    rest = [
        _like(n, v, C)
        for n, v in (("phase", phase), ("jitter", jitter), ("before", before), ("section", section))
    ]
    L = np.broadcast_to(np.asarray(lock), C.shape[:1])
    S = np.where((L >= 0).reshape(-1, *[1] * (C.ndim - 1)), rest[3], 0.0)
    if np.any(rest[2] + S > C * (1 + 1e-9)):
        raise invalid("before + section", float(np.max(rest[2] + S)), "at most the execution")
    given = [_whole(x) for x in (C, T, *rest[:3], S)]
    loop = compiled(_run, _RUN)
    end = round(1e9 * positive("seconds", seconds, unit="s"))
    kind = PROTOCOLS.index(one_of("protocol", protocol, PROTOCOLS))
    result = loop(*given, np.array(L, np.int64), end, kind)
    longest, jobs, late = (x.reshape(C.shape) for x in result)
    return Outcome(1e-9 * longest, jobs, late)


_RUN = types.Array(numba.int64, 3, "C")(
    *[_TABLE] * 6, types.Array(numba.int64, 1, "C"), numba.int64, numba.int64
)


def _run(C, T, phase, jitter, before, section, lock, end, protocol):
    n, sets = C.shape
    result = np.zeros((3, n, sets), np.int64)
    holds, done, job = np.empty(n, np.bool_), np.empty(n, np.int64), np.empty(n, np.int64)
    for s in range(sets):
        holds[:], done[:], job[:], t = False, 0, 0, 0
        while t < end:
            # The running job is the one with the highest current priority, `place`: the first that
            # is released and has the lock it needs, or the job that holds that lock.
            picked, rank, until = -1, n, end
            for i in range(n):
                release = phase[i, s] + (job[i] * T[i, s] if job[i] else jitter[i, s])
                if release > t:
                    until = min(until, release)
                    continue
                runs, place = i, i
                # Ceiling: the holder has the priority of the highest task that uses the lock.
                if holds[i]:
                    for j in range(i if protocol == 2 else 0):
                        if lock[j] == lock[i] and place == i:
                            place = j
                elif section[i, s] and done[i] == before[i, s]:
                    # Blocked: with inheritance the holder runs in the place of the blocked task.
                    for j in range(n):
                        if holds[j] and lock[j] == lock[i]:
                            runs = j if protocol == 1 else -1
                if runs >= 0 and (place < rank or (place == rank and holds[i])):
                    picked, rank = runs, place
            if picked < 0:
                t = until
                continue
            # Run it until it takes or releases its lock, ends, or a release preempts it.
            i, finish = picked, before[picked, s] + section[picked, s]
            if section[i, s] and done[i] == before[i, s]:
                holds[i] = True
            stop = C[i, s]
            if section[i, s] and done[i] < before[i, s]:
                stop = before[i, s]
            elif holds[i]:
                stop = finish
            # Until the next event: the end of this piece of work, or a release.
            step = min(stop - done[i], until - t)
            t += step
            done[i] += step
            if holds[i] and done[i] == finish:
                holds[i] = False
            if done[i] == C[i, s]:
                response = t - phase[i, s] - job[i] * T[i, s]
                result[0, i, s] = max(result[0, i, s], response)
                result[1, i, s] += 1
                result[2, i, s] += response > T[i, s]
                job[i] += 1
                done[i] = 0
        for i in range(n):  # jobs whose period is over
            due = (end - phase[i, s]) // T[i, s]
            result[2, i, s] += max(0, due - job[i])
    return result


def random_sets(
    n: int, load: float, sets: int, rng: np.random.Generator, ratio: float = 100.0
) -> tuple[Array, Array]:
    """Return executions and periods of random sets with a utilization, shapes (n, sets) [s].

    Evenly over all ways to share it (Bini and Buttazzo, Measuring the performance of
    schedulability tests, 2005); periods evenly in the logarithm from 10 ms to `ratio` times that,
    sorted.
    """
    # UUniFast (Bini and Buttazzo, 2005): uniform over all shares with this sum.
    n, remaining = count("n", n, 1), np.full(count("sets", sets, 1), positive("load", load))
    share = np.empty((n, sets))
    for i in range(n - 1):
        rest = remaining * rng.random(sets) ** (1.0 / (n - 1 - i))
        share[i], remaining = remaining - rest, rest
    share[-1] = remaining
    T = np.sort(0.01 * positive("ratio", ratio) ** rng.random((n, sets)), axis=0)
    return np.maximum(share * T, 1e-9), T


def _sets(execution: ArrayLike, period: ArrayLike) -> tuple[Array, Array]:
    C = vector("execution", execution, (None,), (None, None), low=1e-9, unit="s")
    T = vector("period", period, C.shape, low=1e-9, unit="s")
    return C, T


def _like(name: str, value: ArrayLike, C: Array) -> Array:
    values = vector(name, value, low=0.0, unit="s")
    if values.shape not in ((), C.shape, C.shape[:1]):
        raise invalid(f"{name}.shape", values.shape, f"() or {C.shape}")
    tall = values.reshape(-1, 1) if values.ndim == 1 and C.ndim == 2 else values
    return np.broadcast_to(tall, C.shape)


def _whole(x: Any) -> NDArray[np.int64]:
    table = np.ascontiguousarray(np.rint(1e9 * np.asarray(x)).astype(np.int64))
    return table.reshape(table.shape[0], -1)


def warm() -> None:
    """Compile, or load from the cache, what this file compiles."""
    C, T = np.array([0.1, 0.2]), np.array([1.0, 2.0])
    response_times(C, T)
    breakdown(C, T)
    run(C, T, 1.0)
