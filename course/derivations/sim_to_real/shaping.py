"""Claims of chapter 8: what shaping changes and what it does not, and a bound on the gap."""

from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "gamma": Symbol("discount", 0.1, 0.99),
    "p0": Symbol("potential of the first state"),
    "p3": Symbol("potential of the last state"),
    "Q": Symbol("value of an action, unshaped"),
    "phi": Symbol("potential of its state"),
    "c": Symbol("penalty of a step"),
    "eps": Symbol("total variation distance of the next state", 0.01, 0.5),
    "R": Symbol("largest reward of a step"),
}


def drawn(rng, ends=0, states=6):
    """Return a process with two actions and `ends` states in which it ends."""
    from course.sim_to_real import Process

    P, R = rng.dirichlet(np.full(states, 0.3), (states, 2)), rng.normal(size=(states, 2, states))
    last = np.arange(states) >= states - ends
    P[last], R[last] = np.eye(states)[last][:, None], 0.0
    return Process(P, R, 0.95, last)


@claim(
    "Over three steps, the discounted shaping rewards add up to the discounted last potential "
    "minus the first.",
    "All terms between cancel, for any number of steps. What remains depends on the trajectory "
    "only through its start, its end and its length.",
    ask=(
        "Shaping adds gamma phi(s') - phi(s) to the reward of a step from s to s'. The first state "
        "has the potential p0, the state after the third step p3. What is the discounted sum of "
        "all that shaping adds?",
        "gamma^3*p3 - p0",
        {
            "p3 - p0": "That is without discount.",
            "gamma^2*p3 - p0": "The third step is discounted by gamma^2, its potential once more.",
            "gamma^3*(p3 - p0)": "The first potential is not discounted.",
        },
    ),
)
def telescoped_sum(result):
    import sympy

    from course.sim_to_real import shaped

    gamma, p0, p3 = sympy.symbols("gamma p0 p3", positive=True)
    result.formula = gamma**3 * p3 - p0
    p = sympy.symbols("p0:12")
    terms = [gamma**k * (gamma * p[k + 1] - p[k]) for k in range(11)]
    cancels = [sympy.expand(sum(terms[:n]) - (gamma**n * p[n] - p[0])) == 0 for n in range(1, 12)]
    phi, free = result.rng.normal(size=6), drawn(result.rng)
    extra = (shaped(free, phi).reward - free.reward)[:, 0]
    path = result.rng.integers(0, 6, 12)
    paid = np.cumsum([0.95**k * extra[path[k], path[k + 1]] for k in range(11)])
    three = float(result.formula.subs({gamma: 0.95, p0: phi[path[0]], p3: phi[path[3]]}))
    result.measure("paid", paid[-1], 1e-9)
    result.statement = "Eleven steps through a drawn process, summed."
    result.statement_holds(abs(paid[2] - three) < 1e-12)
    result.correction_holds(
        all(cancels), abs(paid[-1] - (0.95**11 * phi[path[11]] - phi[path[0]])) < 1e-12
    )


@claim(
    "Potential-based shaping keeps the best policy, whatever the potential.",
    "Where an episode ends, gamma^T phi of the terminal state stays in the sum, and the policy "
    "chooses where and when it ends. With an arbitrary potential at the terminal states the best "
    "policy changed in {free:.0f} of {n:.0f} random processes with two terminal states, and in "
    "{single:.0f} of those with one. With a potential of 0 there it never changed.",
)
def shaping_keeps_the_best(result):
    from course.sim_to_real import (
        Process,
        evaluate_policy,
        policy_iteration,
        shaped,
        value_iteration,
    )

    def retained(free_end, ends=2):
        process, phi = drawn(result.rng, ends), 5.0 * result.rng.normal(size=6)
        best = value_iteration(process).value
        policy = value_iteration(shaped(process, phi, free_end=free_end)).policy
        return bool(np.allclose(evaluate_policy(process, policy), best, atol=1e-9))

    def discounted(gamma):
        """Return whether shaping with a discount of its own keeps the best policy."""
        process, phi = drawn(result.rng, 2), 5.0 * result.rng.normal(size=6)
        other = replace(shaped(replace(process, gamma=gamma), phi), gamma=process.gamma)
        values = evaluate_policy(process, value_iteration(other).policy)
        return bool(np.allclose(values, value_iteration(process).value, atol=1e-9))

    n = result.input("n", 40)
    zero, free = ([retained(end) for _ in range(n)] for end in (False, True))
    result.measure("free", n - sum(free), 0.0)
    single = result.measure("single", n - sum(retained(True, 1) for _ in range(n)), 0.0)
    unlike = [discounted(x) for x in result.rng.uniform(0.8, 0.9, n)]

    def harder(gamma, ends):
        """Return whether it holds for large potentials and moves that are certain."""
        P = np.eye(6)[result.rng.integers(0, 6, (6, 3))]
        last = np.arange(6) >= 6 - ends
        P[last] = np.eye(6)[last][:, None]
        # Rewards in tenths, so that several policies are equally good.
        R = np.round(result.rng.normal(size=P.shape), 1) * ~last[:, None, None]
        process = Process(P, R, gamma, last)
        other = shaped(process, 100.0 * result.rng.normal(size=6))
        values = evaluate_policy(process, policy_iteration(other).policy)
        return bool(np.allclose(values, policy_iteration(process).value, atol=1e-7))

    result.statement = "Six states, two actions, solved exactly."
    result.statement_holds(
        all(free),
        only_if="the potential is 0 where an episode ends, and is discounted as the rewards are",
        inside=zero
        + [discounted(0.95)]
        # Chosen to break it: ties, certain moves, large potentials, one end to three.
        + [harder(gamma, ends) for gamma in (0.3, 0.9, 0.999) for ends in (0, 1, 2, 3)],
        outside=free + unlike,
    )
    result.correction_holds(all(zero), sum(free) < 0.8 * n, single > 3, not all(unlike))


@claim(
    "If episodes end only by a time limit, the potential of the last state can be arbitrary.",
    "Without bootstrapping, the time limit is an end like any other: gamma^T phi of the last state "
    "stays in the sum. With {steps:.0f} steps to go, the best first action changed in {cut:.0f} of "
    "{n:.0f} random processes without terminal states. It never changed when the value of the "
    "last state under the shaped reward was added at the time limit.",
)
def time_is_an_end(result):
    from course.sim_to_real import shaped, value_iteration

    n, steps = int(result.input("n", 40)), int(result.input("steps", 2))

    def first(process, value, count):
        """Return best first actions, with `count` steps to go and this value of the last state."""
        for _ in range(count):
            q = process.backup(value)
            value = q.max(axis=1)
        return q.argmax(axis=1)

    def retained(valued, plain=False, count=steps, size=5.0, gamma=0.95):
        process, phi = drawn(result.rng), size * result.rng.normal(size=6)
        process = replace(process, gamma=gamma)
        used = process if plain else shaped(process, phi)
        last = [valued * value_iteration(p).value for p in (process, used)]
        after = first(shaped(process, phi), last[1], count)
        return bool(np.all(first(process, last[0], count) == after))

    valued, cut = ([retained(x) for _ in range(n)] for x in (1.0, 0.0))
    result.measure("cut", n - sum(cut), 0.0)
    # The value of the same state, but under the reward without shaping.
    unshaped = [retained(1.0, plain=True) for _ in range(n)]
    result.statement = "Six states, two actions, by backward recursion."
    result.statement_holds(
        all(cut),
        only_if="the learner adds the value of the last state under the shaped reward",
        inside=valued
        # Chosen to break it: other numbers of steps and discounts, large potentials.
        + [retained(1.0, count=k, size=100.0, gamma=g) for k in (1, 5, 40) for g in (0.3, 0.9)],
        outside=cut + unshaped,
    )
    result.correction_holds(all(valued), sum(cut) < 0.8 * n, sum(unshaped) < 0.8 * n)


@claim(
    "A reward for being close at each step can favour another path than a reward for getting "
    "closer.",
    "Of {n:.0f} random pairs of paths, {flipped:.0f} have another best path when minus the "
    "distance is paid at each step. Paid as a difference of potentials, the short path stays the "
    "best in all of them. A longer path that soon comes near the goal can cost less than a "
    "shorter one that stays far away until its last steps.",
)
def two_routes(result):
    from course.sim_to_real import Process, shaped, value_iteration

    def choice(distances, paid):
        """Return which of two paths from state 0 is best, and both distances."""
        sizes = [len(path) for path in distances]
        S = sum(sizes) + 2
        P, starts = np.zeros((S, 2, S)), (1, 1 + sizes[0])
        for k, (start, size) in enumerate(zip(starts, sizes, strict=True)):
            P[0, k, start] = 1.0
            for s in range(start, start + size):
                P[s, :, s + 1 if s + 1 < start + size else S - 1] = 1.0
        P[-1, :, -1] = 1.0
        R = np.zeros((S, 2, S))
        R[:-1, :, -1] = 1.0
        d = np.array([1.0, *distances[0], *distances[1], 0.0])
        if paid == "distance":
            R[:-1] -= d
        process = Process(P, R, 0.95, np.arange(S) == S - 1)
        return value_iteration(shaped(process, -d) if paid == "potential" else process).policy[0]

    n, flips, retained = int(result.input("n", 40)), [], []
    for _ in range(n):
        paths = [result.rng.uniform(0.1, 2.0, int(m)) for m in result.rng.permutation(10)[:2] + 1]
        best = choice(paths, "goal")
        flips.append(choice(paths, "distance") != best)
        retained.append(choice(paths, "potential") == best == int(len(paths[0]) > len(paths[1])))
    flipped = result.measure("flipped", sum(flips), 0.0)
    result.statement = "Two ways of one to ten states to a goal that pays, solved exactly."
    result.statement_holds(flipped > 0)
    result.correction_holds(all(retained), flipped < n)


@claim(
    "Shaping turns Q into Q - phi + gamma phi.",
    "Shaping turns Q into {formula}, if nothing ends or terminal states have the potential 0: the "
    "sum telescopes to minus the potential of the state in which the action is taken. This is the "
    "same for all actions, so the best one stays.",
    ask=(
        "Rewards are shaped with gamma phi(s') - phi(s), in a task that never ends. What is the "
        "new value of an action with the value Q, in a state with the potential phi?",
        "Q - phi",
        {
            "Q - phi + gamma*phi": "The next state is another one, and its potential cancels.",
            "Q + phi": "The state's potential is taken off.",
            "Q - gamma*phi": "The state's own potential is not discounted.",
        },
    ),
)
def q_of_shaped(result):
    import sympy

    from course.sim_to_real import shaped, value_iteration

    Q, p = sympy.symbols("Q phi")
    result.formula = Q - p
    phi = result.rng.normal(size=6)

    def deviation(ends, factor, free_end=False):
        """Return the largest difference of the shaped Q from Q - factor phi, 0 at the ends."""
        process, live = drawn(result.rng, ends), phi * (np.arange(6) < 6 - ends)
        change = value_iteration(shaped(process, phi, free_end=free_end)).q
        return np.abs(change - value_iteration(process).q + factor * live[:, None]).max()

    received = result.measure("heard_off", deviation(0, 0.05), 1e-6)
    result.statement = "Drawn processes with none to two ends, solved before and after."
    result.statement_holds(received < 1e-9)
    result.correction_holds(
        max(deviation(ends, 1.0) for ends in (0, 1, 2)) < 1e-10, deviation(2, 1.0, True) > 0.01
    )


@claim(
    "A constant penalty for each step is not potential-based shaping.",
    "Without an end it is: phi = {formula} everywhere pays -c each step. Nor does it matter if, "
    "from each state, all paths to the end have the same length, or if only a time limit ends "
    "episodes. Otherwise the potential, 0 at the "
    "end, would have to know how many steps are still to come, which the action decides: a penalty "
    "can change what is best.",
    ask=(
        "In a task without terminal states, which constant potential adds a shaping reward of -c "
        "to every step?",
        "phi = c/(1 - gamma)",
        {
            "-c/(1 - gamma)": "gamma phi - phi has the other sign.",
            "c": "Then a step costs (1 - gamma) c.",
            "c/gamma": "Solve gamma phi - phi = -c.",
        },
    ),
)
def step_penalty(result):
    import sympy

    from course.sim_to_real import Process

    gamma, c, p = sympy.symbols("gamma c phi", positive=True)
    result.formula = sympy.solve(sympy.Eq(gamma * p - p, -c), p)[0]

    def remaining(process):
        """Return the largest share of a unit penalty that no potential (0 at ends) compensates."""
        S, inner = len(process.terminal), np.count_nonzero(~process.terminal)
        pairs = [(s, n) for s, _, n in np.argwhere(process.transition > 0.0) if s < inner]
        rows = np.array([0.95 * np.eye(S)[n] - np.eye(S)[s] for s, n in pairs])[:, :inner]
        best = np.linalg.lstsq(rows, -np.ones(len(rows)), rcond=None)[0]
        return np.abs(rows @ best + 1.0).max()

    def chain(n):
        """Return n states, each left for the next by either action, the last one an end."""
        P = np.repeat(np.eye(n, k=1)[:, None], 2, axis=1)
        P[-1, :, -1] = 1.0
        return Process(P, 0.0 * P, 0.95, np.arange(n) == n - 1)

    def branching(n):
        """Return what remains in a graph without loops, and the lengths of each state's paths."""
        step = [result.rng.integers(s + 1, n, 2) if s % 3 else [s + 1] * 2 for s in range(n - 1)]
        P, lengths = np.zeros((n, 2, n)), [set() for _ in range(n - 1)] + [{0}]
        P[-1, :, -1] = 1.0
        for s in range(n - 2, -1, -1):
            P[s, [0, 1], step[s]] = 1.0
            lengths[s] = {1 + size for end in step[s] for size in lengths[end]}
        return remaining(Process(P, 0.0 * P, 0.95, np.arange(n) == n - 1)), lengths

    ended, endless = ([remaining(drawn(result.rng, e)) for _ in range(8)] for e in (1, 0))
    chains = [remaining(chain(n)) for n in result.rng.integers(3, 9, 8)]
    result.measure("least_left_with_an_end", min(ended), 0.01)
    result.statement = "The potential that comes closest, by least squares: drawn, and in chains."
    # Chosen to break it: graphs in which only some states have paths of several lengths, or none.
    graphs = [branching(int(n)) for n in result.rng.integers(3, 10, 60)]
    several = [x for x, lengths in graphs if max(map(len, lengths)) > 1]
    single = [x for x, lengths in graphs if max(map(len, lengths)) == 1]

    def limited(steps, states=4):
        """Return what remains where only a time limit ends episodes, which the state shows."""
        N = states * steps + 1
        P = np.zeros((N, 2, N))
        for k in range(steps - 1):
            here, then = (slice(states * j, states * (j + 1)) for j in (k, k + 1))
            P[here, :, then] = result.rng.dirichlet(np.ones(states), (states, 2))
        P[N - 1 - states :, :, -1] = 1.0
        return remaining(Process(P, 0.0 * P, 0.95, np.arange(N) == N - 1))

    # Chosen to break it: the time limit is the only end.
    timed = [limited(int(n)) for n in result.rng.integers(2, 8, 8)]
    inside, outside = (
        [x > 1e-9 for x in some] for some in (ended + several, endless + chains + single + timed)
    )
    result.statement_holds(
        all(outside),
        only_if="episodes can end otherwise than by a time limit, and from some state paths of "
        "different length lead to such an end",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        max(endless) < 1e-9,
        max(chains) < 1e-9,
        max(single) < 1e-9,
        max(timed) < 1e-9,
        float(result.formula.subs({gamma: 0.95, c: 1})) > 19.9,
    )


@claim(
    "If the next state's distribution is wrong by eps, a policy's value is wrong by eps R / "
    "(1 - gamma) at most.",
    "The error is made anew in each step: for rewards from 0 to R that don't depend on the next "
    "state, the bound is {formula}. A chain that the simulator "
    "keeps where it is paid and the robot leaves with probability eps reaches {share:.1%} of it, "
    "{factor:.0f} times the claimed bound. Of two deterministic simulators that differ eps is 1: "
    "there it says nothing, once gamma is above a half.",
    ask=(
        "Two worlds share the discount gamma and rewards from 0 to R that don't depend on the next "
        "state; their distributions of the next state differ by at most eps in total variation. "
        "By how much can the value of a policy differ at most?",
        "gamma*eps*R/(1 - gamma)^2",
        {
            "eps*R/(1 - gamma)": "That is one wrong step; each step is wrong.",
            "eps*R/(1 - gamma)^2": "The first reward is paid before a next state is drawn.",
            "2*gamma*eps*R/(1 - gamma)^2": "eps is half of the summed differences.",
        },
    ),
)
def gap_of_values(result):
    import sympy

    from course.sim_to_real import Process, evaluate_policy, transfer_bound

    g, e, R, D = sympy.symbols("gamma eps R D", positive=True)
    # The difference D is that of one expectation, and D again after it.
    result.formula = sympy.solve(sympy.Eq(D, g * (e * R / (1 - g) + D)), D)[0]
    gamma, eps = 0.95, 1e-3
    pays, ends = np.zeros((2, 1, 2)), np.zeros(2, dtype=bool)
    pays[0] = 1.0

    def lost(gamma, eps, pays=pays):
        """Return what the chain of two states loses to the one that stays."""
        moves = (np.array([[[1 - x, x]], [[0.0, 1.0]]]) for x in (0.0, eps))
        sure, leaves = (evaluate_policy(Process(P, pays, gamma, ends), [0, 0])[0] for P in moves)
        return sure - leaves

    bound = transfer_bound(gamma, eps)
    law = float(result.formula.subs({g: gamma, e: eps, R: 1}))
    share = result.measure("share", lost(gamma, eps) / bound)
    factor = result.measure("factor", lost(gamma, eps) * (1 - gamma) / eps)

    def within(gamma):
        """Return whether a random pair of worlds keeps the claimed bound, for a random policy."""
        paid = np.repeat(result.rng.integers(0, 2, (4, 2, 1)).astype(float), 4, axis=2)
        one, other = result.rng.dirichlet(np.full(4, 0.2), (2, 4, 2))
        other = one + 10.0 ** result.rng.uniform(-3, 0) * (other - one)
        apart = 0.5 * np.abs(one - other).sum(axis=2).max()
        free, policy = np.zeros(4, dtype=bool), result.rng.integers(0, 2, 4)
        a, b = (evaluate_policy(Process(P, paid, gamma, free), policy) for P in (one, other))
        return bool(np.abs(a - b).max() * (1.0 - gamma) <= apart)

    result.statement = "Two states, a discount of 0.95 and a distance of 0.001; and drawn ones."
    low, high = result.rng.uniform(0.05, 0.5, 8), result.rng.uniform(0.51, 0.99, 8)
    # The same chain, paid for where a step leads, or fined where it ends up.
    staying, fined = np.zeros((2, 1, 2)), pays.copy()
    staying[0, 0, 0], fined[1] = 1.0, -1.0
    beyond = [lost(x, eps, staying) / transfer_bound(x, eps) for x in low]
    beyond += [lost(x, eps, fined) / transfer_bound(x, eps) for x in low]
    result.statement_holds(
        factor <= 1.0,
        only_if="the discount is a half or less, and rewards from 0 to R don't depend on the next "
        "state",
        inside=[transfer_bound(x, eps) * (1 - x) <= eps for x in low]
        # Chosen to break it: worlds far apart, rewards of 0 and R only, a discount of a half.
        + [within(x) for x in (*low, *(0.5 for _ in range(24)))],
        outside=[lost(x, eps) * (1 - x) <= eps for x in high]
        + [lost(x, eps, staying) * (1 - x) <= eps for x in low],
    )
    result.correction_holds(
        abs(bound / law - 1.0) < 1e-9,
        0.9 < share <= 1.0,
        factor > 10.0,
        min(beyond) > 1.5,
        all((transfer_bound(x, 1.0) >= 1.0 / (1.0 - x)) == (x > 0.5) for x in (*low, *high)),
    )
