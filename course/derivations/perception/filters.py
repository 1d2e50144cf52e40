"""Claims of chapter 7: when a measurement of a filter is valid."""

import numpy as np

from course.derivations import claim


@claim(
    "If a legged robot's contact sensor is late, a gate on the innovation rejects the wrong leg "
    "readings.",
    "Right after lift-off the wrong reading hardly differs from the right one, so it passes the "
    "gate, and the filter is pulled away and becomes sure of itself. With a sensor that is up to "
    "{late:.0f} samples late, {gated:.0%} of the runs with a gate had more than "
    "{factor:.0f} times the Cramér-Rao bound as their height error. With a test for load in the "
    "accelerometer, which shows lift-off at once, it was {loaded:.0%}. Over all of these runs the "
    "error was then {ratio:.2f} times the bound.",
)
def gate_replaces_contact(result):
    from course.perception.hopper import hop_bound, hop_filter, hop_logs

    late, factor = int(result.input("late", 4)), result.input("factor", 3)

    def errors(logs, rule):
        """Return the mean squared height errors of logs and their bounds, from a third on."""
        rows = []
        for log in logs:
            scored = len(log.force) // 3
            away = hop_filter(log, rule)[0][scored:, 0] - log.height[scored:]
            rows.append((np.mean(away**2), np.mean(hop_bound(log)[scored:, 0, 0])))
        return np.array(rows).T

    logs = hop_logs(result.rng, 150, late=late)
    gate, load = (errors(logs, rule) for rule in ("flag and gate", "load and gate"))
    gated, loaded = (float(np.mean(a > factor**2 * b)) for a, b in (gate, load))
    result.measure("gated", gated, 0.3)
    result.measure("loaded", loaded, 0.05)
    ratio = result.measure("ratio", float(np.sqrt(load[0].mean() / load[1].mean())), 0.1)
    result.statement = (
        "Simulated hoppers with a noisy accelerometer, a leg encoder and a late contact sensor."
    )
    # A sensor that is right needs no gate: the lateness is what does the harm.
    right = errors(hop_logs(result.rng, 60, late=0, wrong=0.0), "flag and gate")
    result.statement_holds(gated <= loaded)
    result.correction_holds(
        gated > 0.25,
        loaded < 0.05,
        0.85 < ratio < 1.15,
        float(np.sqrt(right[0].mean() / right[1].mean())) < 1.2,
    )
