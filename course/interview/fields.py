"""Where the numbers of a text come from: a field in braces is filled when the text is shown.

    {semi_implicit_limit.limit_ms:.1f}           a figure of `course.derivations`
    {estimate.night_workers:.0f}                 one of `course.interview.estimates`
    {estimate.night_workers.scenario_s:.0f}      an input of it
    {chart.plan_times/discs/ours/x@0.5:.2g}      from the data of the chart plan_times

Behind `chart.` stand the name of the chart and steps into its data, with `/` between them. A step
is a key; the number of an entry, or how its title, label or name begins (one entry only); `ours`
or `oracle`, the curves of that style; `pick`, the cheapest of their points within the chart's
tolerance; `min` or `max` of a column; `y@0.5` (or `low@`, `high@`), the column where x is that;
`x@0.5`, where y first passes that, and `x@low=0.5` or `x@high=0.5`, where an end of its band does.

Behind the colon stands a format of Python; or `time` for seconds, two digits, in a unit that fits;
or `points` for a share in percentage points, two digits and no unit.
"""

import re
from collections.abc import Callable

from course.check import invalid
from course.interview.chart_data import chart
from course.interview.estimates import ESTIMATES

Figure = Callable[[str, str], float | str]

FIELD = re.compile(r"\{(\w+)\.([^{}:]+)(?::([^{}]*))?\}")


def filled(text: str, figure: Figure) -> str:
    """Return a text with its fields replaced by what they stand for.

    Args:
        text: with fields as above.
        figure: (claim, name) -> the figure; `course.derivations.figure`.

    Raises:
        ValueError: for a field that nothing fills.
    """
    return FIELD.sub(lambda m: _formatted(value(m[1], m[2], figure), m[3] or ""), text)


def _formatted(result: float | str, how: str) -> str:
    if how == "points" and not isinstance(result, str):
        return f"{float(f'{100.0 * result:.2g}'):g}"
    if how != "time" or isinstance(result, str):
        return format(result, how)
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if result >= size or unit == "us":
            break
    return f"{float(f'{result / size:.2g}'):g} {unit}"


def value(source: str, name: str, figure: Figure) -> float | str:
    """Return what a field `{source.name}` stands for."""
    if source == "chart":
        return chart(name)
    return estimate(name) if source == "estimate" else figure(source, name)


def estimate(name: str) -> float | str:
    """Return an estimate, or with `NAME.INPUT` one of its inputs."""
    key, _, given = name.partition(".")
    if key not in ESTIMATES:
        raise invalid("estimate", key, f"one of {', '.join(ESTIMATES)}")
    inputs = ESTIMATES[key].given()
    if not given:
        return ESTIMATES[key].value()
    if given not in inputs or isinstance(inputs[given], list):
        raise invalid(f"input of {key}", given, f"one of {', '.join(inputs)}")
    return inputs[given]
