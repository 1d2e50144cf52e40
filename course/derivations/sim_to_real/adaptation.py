"""Claims of chapter 8: controllers of arms that differ in every episode."""

import numpy as np

from course.derivations import claim


@claim(
    "No controller does better on an arm than the best gains in hindsight.",
    "The best gains in hindsight bound the gain sets that were searched, all with the same "
    "estimate of the arm. A controller that knows the arm changes the estimate as well: with one "
    "gain set for all {n:.0f} arms its error is smaller than this bound on {share:.0%} of them, "
    "and {ratio:.2f} times as large in the mean. Gains that the search left out are below the "
    "bound, too, if it was coarse: {more:.0f} further sets, sampled between those of the list, "
    "are on {off:.0%} of the arms.",
)
def best_fixed_gains(result):
    from course.sim_to_real import varying_arms as va

    n, sets = int(result.input("n", 24)), va.candidates()
    tuned_on, paths = va.family(12, result.rng), va.references(12, result.rng)
    gains = sets[va.best(va.evaluate(tuned_on, paths, sets, estimate=tuned_on))]
    arms, paths = va.family(n, result.rng), va.references(n, result.rng)
    errors = va.evaluate(arms, paths, sets)
    bound = errors.min(axis=0)
    knows = va.track(arms, gains, paths, estimate=arms).error
    # Fixed gains anywhere between those of the list.
    low, high = np.array(sets).min(axis=0), np.array(sets).max(axis=0)
    further = [
        va.Gains(*np.concatenate([np.exp(result.rng.uniform(*np.log([low[:2], high[:2]]))), x]))
        for x in result.rng.uniform(low[2], high[2], (int(result.input("more", 200)), 1))
    ]
    others = va.evaluate(arms, paths, further).min(axis=0)
    share = result.measure("share", np.mean(knows < bound), 0.3)
    ratio = result.measure("ratio", knows.mean() / bound.mean(), 0.3)
    below = result.measure("off", np.mean(others < bound), 0.5)
    result.statement = "24 sampled arms and references, one seed of noise."
    result.statement_holds(bool(np.all(knows >= bound)))
    result.correction_holds(share > 0.2, ratio < 0.9, below > 0.0, bool(np.all(errors >= bound)))
