"""What the wrong results of a function have in common, where no known mistake gives them.

Every sentence is computed from the results and holds for all of them: a term that is missing in
each, a factor that each has too many, a place where each is wrong, a limit that divides the wrong
cases from the right ones. A sentence that some wrong result contradicts is not given, nor is one
that results of a few cases may fulfil by chance.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Answer, largest_error
from drills.values import as_float64

Array = NDArray[np.float64]
Named = dict[str, Array]
NAMES = frozenset(
    {
        "same_everywhere",
        "term_of_arguments",
        "factor_of_arguments",
        "common_factor",
        "signs_only",
        "whole_turns",
        "other_order",
        "length_right",
        "one_place_wrong",
        "one_condition",
        "one_sided",
    }
)
FEWEST = 3  # wrong cases of which something is said that each of them could fulfil alone
CHANCE = 1e-3  # that a condition without meaning fits all cases
GAP = 0.1  # of a feature's range: as far apart have to be wrong and right for a limit between them
AGREES = 1e-9  # relative to the largest number of a result, or to 1: a number that is right
FITS = 1e-6  # relative to the largest number of a term that is looked for
POWERS = (1, 2, -1, -2, 0.5, -0.5)
TURNS = ((2.0 * math.pi, "2 pi"), (math.pi, "pi"), (0.5 * math.pi, "pi/2"), (360.0, "360"))
CLOSE = 0.01  # a factor nearer to 1 is an approximation
SIDED = 6  # wrong cases that all have to lie on one side


@dataclass(frozen=True)
class Wrong:
    """One result that is wrong: the arguments by name, what came back, what is right."""

    arguments: Named
    got: Array
    truth: Array

    @property
    def error(self) -> Array:
        """What came back minus what is right."""
        return self.got - self.truth

    @property
    def wrong(self) -> NDArray[np.bool_]:
        """Which numbers are wrong."""
        scale = max(1.0, float(np.max(np.abs(self.truth), initial=0.0)))
        return np.asarray(np.abs(self.error) > AGREES * scale)


def form(attempt: Attempt) -> tuple[str, str]:
    """Return a name and a sentence on the form of the wrong results, or two times ""."""
    return _first(attempt, _form)


def division(attempt: Attempt) -> tuple[str, str]:
    """Return a name and a sentence on what divides wrong from right, or two times ""."""
    return _first(attempt, _division)


Finding = tuple[str, str] | None


def _first(
    attempt: Attempt, search: Callable[[Sequence[Wrong], Sequence[Wrong], str], Finding]
) -> tuple[str, str]:
    """Return the first sentence on a result of the function, with its name, or two times ""."""
    answers: list[Answer] = attempt.answers
    returns = [v.name for v in attempt.card.signatures[0].returns]
    names = [v.name for v in attempt.card.signatures[0].arguments]
    with np.errstate(all="ignore"):
        for i, name in enumerate(returns):
            if any(largest_error(a.parts[i], a.truth[i]) == np.inf for a in answers):
                continue
            rows = [
                Wrong(_numeric(names, a), as_float64(a.parts[i], a.truth[i].shape), a.truth[i])
                for a in answers
            ]
            right = [row for a, row in zip(answers, rows, strict=True) if a.right[i]]
            wrong = [row for a, row in zip(answers, rows, strict=True) if not a.right[i]]
            if not wrong or not all(row.wrong.any() for row in wrong):
                continue
            if result := search(right, wrong, f"`{name}`" if len(returns) > 1 else "the result"):
                return result
    return "", ""


def _form(right: Sequence[Wrong], wrong: Sequence[Wrong], what: str) -> Finding:
    in_every = f"In every case that is wrong, {what}"
    result = (
        _same([*right, *wrong], wrong, what)
        or _term(wrong, in_every)
        or _factor(wrong, in_every)
        or _preserved(wrong, in_every)
        or _place(wrong, in_every)
    )
    if result and (where := _condition(right, wrong, what)):
        return result[0], f"{result[1]} {where[1]}"
    return result


def _division(right: Sequence[Wrong], wrong: Sequence[Wrong], what: str) -> Finding:
    return (
        _condition(right, wrong, what)
        or _condition_of_numbers([*right, *wrong], wrong, what)
        or _side(right, wrong, what)
    )


def _numeric(names: Sequence[str], a: Answer) -> Named:
    """Return the arguments that are numbers or arrays of numbers."""
    result = {}
    for name, value in zip(names, a.case.args, strict=False):
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            continue
        if array.size and np.isfinite(array).all():
            result[name] = array
    return result


def _same(rows: Sequence[Wrong], wrong: Sequence[Wrong], what: str) -> Finding:
    """Return a sentence on a result that never changes."""
    if len(wrong) < FEWEST:
        return None
    if not any(row.got.any() for row in rows):
        return "same_everywhere", f"In every case, {what} holds nothing but zeros."
    got, truth = rows[0].got, rows[0].truth
    if any(not np.array_equal(row.got, got) for row in rows):
        return None
    if all(np.array_equal(row.truth, truth) for row in rows):
        return None
    shown = f" ({float(got.ravel()[0]):.4g})" if got.size == 1 else ""
    return "same_everywhere", f"In every case, {what} is the same{shown}; the right one changes."


# --- Terms and factors that are made of the arguments ---------------------------------------------


def _scalars(row: Wrong) -> Named:
    """Return numbers that a case has: its scalar arguments, then lengths, norms and sums."""
    plain = {name: x for name, x in row.arguments.items() if x.ndim == 0}
    for name, x in row.arguments.items():
        if x.ndim > 0:
            plain[f"len({name})"] = np.asarray(float(len(x)))
        if x.ndim == 1:
            plain[f"norm({name})"] = np.asarray(np.linalg.norm(x), dtype=float)
            plain[f"sum({name})"] = np.asarray(x.sum())
    if row.truth.ndim == 1:
        plain["norm(result)"] = np.asarray(np.linalg.norm(row.truth), dtype=float)
        plain["sum(result)"] = np.asarray(row.truth.sum())
    return plain


def _terms(rows: Sequence[Wrong]) -> Iterator[tuple[str, list[Array]]]:
    """Yield products of arguments, in code, with their values in each case."""
    per_case = [_scalars(row) for row in rows]
    scalars = {
        n: [one[n] for one in per_case] for n in per_case[0] if all(n in one for one in per_case)
    }
    powers = dict[str, list[Array]]()
    for name, values in scalars.items():
        for p in POWERS:
            powers[_power(name, p)] = [v**p for v in values]
    yield "", [np.asarray(1.0) for _ in rows]
    yield from powers.items()
    plain = [n for n in rows[0].arguments if n in scalars]
    pairs = [
        (f"{_power(a, p)}*{_power(b, q)}", [x**p * y**q for x, y in zip(*both, strict=True)])
        for a, b in itertools.combinations(plain, 2)
        for both in [(scalars[a], scalars[b])]
        for p in (1, 2, -1)
        for q in (1, 2, -1)
    ]
    yield from pairs
    arrays = {
        n: [row.arguments[n] for row in rows]
        for n in rows[0].arguments
        if all(n in r.arguments and 0 < r.arguments[n].ndim for r in rows)
        and all(r.arguments[n].shape == r.truth.shape for r in rows)
    }
    for name, values in arrays.items():
        yield name, values
        for p in (2, -1, 0.5):
            yield _power(name, p), [v**p for v in values]
        for text, factors in itertools.chain(powers.items(), pairs):
            yield f"{text}*{name}", [f * v for f, v in zip(factors, values, strict=True)]
    for (a, x), (b, y) in itertools.combinations(arrays.items(), 2):
        yield f"{a}*{b}", [u * v for u, v in zip(x, y, strict=True)]
        yield f"({a} - {b})", [u - v for u, v in zip(x, y, strict=True)]


def _power(name: str, p: float) -> str:
    return {1: name, 0.5: f"sqrt({name})", -0.5: f"1/sqrt({name})", -1: f"1/{name}"}.get(
        p, f"{name}**{p}" if p > 0 else f"1/{name}**{-p:g}"
    )


def _multiple(values: Sequence[Array], terms: Sequence[Array]) -> float:
    """Return the one factor that turns each term into its value, 0 if there is none."""
    factor = 0.0
    for value, term in zip(values, terms, strict=True):
        term = np.broadcast_to(term, value.shape)
        at = int(np.argmax(np.abs(term)))
        largest = float(term.ravel()[at])
        if not np.isfinite(term).all() or abs(largest) < 1e-12:
            return 0.0
        if not factor:
            factor = float(value.ravel()[at]) / largest
        size = float(np.max(np.abs(value), initial=0.0))
        if not abs(factor) > 1e-9 or not np.all(np.abs(value - factor * term) <= FITS * size):
            return 0.0
    return factor


def _varies(terms: Sequence[Array]) -> bool:
    """Return whether a term has three values at least, so that it does not fit by chance."""
    numbers = {float(x) for term in terms for x in np.ravel(term)}
    return len(numbers) >= FEWEST


def _term(wrong: Sequence[Wrong], in_every: str) -> Finding:
    """Return a sentence on what came back, or its error, as one product of arguments."""
    if len(wrong) < FEWEST:
        return None
    errors, got = [row.error for row in wrong], [row.got for row in wrong]
    if not _varies(got):
        return None
    for text, terms in _terms(wrong):
        if not text:
            if factor := _multiple(errors, terms):
                sign = "plus" if factor > 0.0 else "minus"
                return "term_of_arguments", (
                    f"{in_every} is the right one {sign} {abs(factor):.6g}: a constant is missing "
                    "or one too many."
                )
            continue
        if not _varies(errors) or not _varies(terms):
            continue
        if factor := _multiple(errors, terms):
            sign = "plus" if factor > 0.0 else "minus"
            return "term_of_arguments", (
                f"{in_every} is the right one {sign} `{_times(abs(factor), text)}`: look for this "
                "term."
            )
        if factor := _multiple(got, terms):
            return "term_of_arguments", (
                f"{in_every} is `{_times(factor, text)}` and nothing else."
            )
    return None


def _times(factor: float, text: str) -> str:
    """Return a product in code, without a factor of 1."""
    if abs(factor - 1.0) < FITS:
        return text
    return f"{factor:.6g}/{text[2:]}" if text.startswith("1/") else f"{factor:.6g}*{text}"


def _factor(wrong: Sequence[Wrong], in_every: str) -> Finding:
    """Return a sentence on what came back as the right result times something."""
    if len(wrong) < FEWEST:
        return None
    ratios = []
    for row in wrong:
        at = int(np.argmax(np.abs(row.truth)))
        largest = float(row.truth.ravel()[at])
        if not largest:
            return None
        ratio = float(row.got.ravel()[at]) / largest
        size = float(np.max(np.abs(row.got), initial=0.0))
        if not size or not np.all(np.abs(row.got - ratio * row.truth) <= FITS * size):
            return None
        ratios.append(np.asarray(ratio))
    for text, terms in _terms(wrong):
        scalar = all(term.ndim == 0 for term in terms)
        if text and scalar and _varies(terms) and (factor := _multiple(ratios, terms)):
            return "factor_of_arguments", (
                f"{in_every} is the right one times `{_times(factor, text)}`: look for this factor."
            )
    several = all(np.count_nonzero(row.truth) > 1 for row in wrong)
    if several and _varies(ratios) and max(abs(ratio - 1.0) for ratio in ratios) > CLOSE:
        return "common_factor", (
            f"{in_every} is a multiple of the right one: its numbers have the right ratios, and "
            f"all of them are {min(ratios):.3g} to {max(ratios):.3g} times too large, by one "
            "factor in each case. Look for a common factor, such as a norm."
        )
    return None


# --- What is right although the numbers are not ---------------------------------------------------


def _preserved(wrong: Sequence[Wrong], in_every: str) -> Finding:
    """Return a sentence on a property of the right result that the wrong ones have too."""

    def all_near(a: Sequence[Array], b: Sequence[Array]) -> bool:
        return all(
            bool(np.all(np.abs(x - y) <= AGREES * max(1.0, float(np.max(np.abs(y), initial=0.0)))))
            for x, y in zip(a, b, strict=True)
        )

    got, truth = [row.got for row in wrong], [row.truth for row in wrong]
    if len(wrong) < FEWEST or not _varies(truth):
        return None
    if all_near([np.abs(x) for x in got], [np.abs(x) for x in truth]):
        return "signs_only", f"{in_every} has the right numbers, and only signs are wrong."
    for turn, word in TURNS:
        turns = [row.error / turn for row in wrong]
        moved = all(np.rint(x[row.wrong]).all() for x, row in zip(turns, wrong, strict=True))
        if moved and all_near([np.rint(x) for x in turns], turns):
            return "whole_turns", (
                f"{in_every} is off by multiples of {word} and by nothing else: look at the range "
                "to which an angle is brought."
            )
    if all(x.ndim > 0 and len(x) > 1 for x in truth):
        if all_near([np.sort(x, axis=None) for x in got], [np.sort(x, axis=None) for x in truth]):
            return "other_order", f"{in_every} has the right numbers, in another order."
    if all(x.ndim == 1 and len(x) > 1 for x in truth):
        lengths = [np.asarray(np.linalg.norm(x), dtype=float) for x in truth]
        if _varies(lengths) and all_near(
            [np.asarray(np.linalg.norm(x), dtype=float) for x in got], lengths
        ):
            return "length_right", f"{in_every} has the right length and the wrong direction."
    return None


def _place(wrong: Sequence[Wrong], in_every: str) -> Finding:
    """Return a sentence on the one place in an array at which it is wrong."""
    masks = [row.wrong for row in wrong]
    if len(wrong) < FEWEST or any(mask.ndim not in (1, 2) for mask in masks):
        return None
    if any(min(mask.shape) < 2 for mask in masks) or len({m.ndim for m in masks}) > 1:
        return None
    at = [np.indices(mask.shape) for mask in masks]
    places: dict[str, list[NDArray[np.bool_]]] = {}
    for axis, word in enumerate(("row", "column") if masks[0].ndim == 2 else ("number",)):
        places[f"the first {word}"] = [i[axis] == 0 for i in at]
        places[f"the last {word}"] = [
            i[axis] == m.shape[axis] - 1 for i, m in zip(at, masks, strict=True)
        ]
        places[f"the first and the last {word}"] = [
            (i[axis] == 0) | (i[axis] == m.shape[axis] - 1) for i, m in zip(at, masks, strict=True)
        ]
    if all(m.ndim == 2 and m.shape[0] == m.shape[1] for m in masks):
        places["the diagonal"] = [i[0] == i[1] for i in at]
        places["what is above the diagonal"] = [i[0] < i[1] for i in at]
        places["what is below the diagonal"] = [i[0] > i[1] for i in at]
        places["what is off the diagonal"] = [i[0] != i[1] for i in at]
    pairs = {name: list(zip(masks, inside, strict=True)) for name, inside in places.items()}
    for name, both in pairs.items():
        if all((~p).any() and not (m & ~p).any() for m, p in both):
            return "one_place_wrong", f"{in_every} is wrong only in {name}, and right elsewhere."
    for name, both in pairs.items():
        # What is the same in all cases, such as a base at the origin, is right by itself.
        inside = [row.truth[p] for row, (_, p) in zip(wrong, both, strict=True)]
        if _varies(inside) and all(p.any() and not (m & p).any() for m, p in both):
            return "one_place_wrong", (
                f"{in_every} is right in {name}: look for what only the other numbers need."
            )
    return None


# --- What divides the wrong cases from the right ones ---------------------------------------------


def _features(row: Wrong) -> dict[str, float]:
    """Return what the cases of a run may differ in."""
    result = {}
    for name, x in row.arguments.items():
        if x.ndim == 0:
            result[f"`{name}`"] = float(x)
            continue
        result[f"the length of `{name}`"] = float(len(x))
        result[f"the smallest number in `{name}`"] = float(x.min())
        result[f"the largest number in `{name}`"] = float(x.max())
    plain = [n for n, x in row.arguments.items() if x.ndim == 0]
    for a, b in itertools.combinations(plain, 2):
        result[f"`{a} - {b}`"] = float(row.arguments[a] - row.arguments[b])
    if row.truth.ndim == 0:
        result["the right result"] = float(row.truth)
    return result


def _divides(
    wrong: Array, right: Array, what: str, feature: str, number: str = "case"
) -> str | None:
    """Return a sentence on a limit that divides wrong from right by one feature, None without."""
    others = "and right in all others."
    for word, holds in (("of 0", np.equal), ("below 0", np.less), ("above 0", np.greater)):
        if holds(wrong, 0.0).all() and not holds(right, 0.0).any():
            return f"{what} is wrong in every {number} with {feature} {word}, {others}"
    if np.all(right == 0.0) and not np.any(wrong == 0.0):
        return f"{what} is right in every {number} with {feature} of 0, and wrong in all others."
    both = np.concatenate((wrong, right))
    # Integers, such as lengths, have limits; of other numbers the sides must lie apart.
    needed = 0.0 if np.array_equal(both, np.rint(both)) else GAP * float(np.ptp(both))
    for sign, side, other in ((1.0, "more", "less"), (-1.0, "less", "more")):
        low, high = float((sign * wrong).min()), float((sign * right).max())
        if low - high > needed:
            return (
                f"{what} is wrong in every {number} with {feature} of {sign * low:.4g} or {side}, "
                f"and right in every one with {sign * high:.4g} or {other}."
            )
    return None


def _no_chance(count_wrong: int, count_right: int, features: int) -> bool:
    """Return whether a limit hardly divides this many by chance, whatever the feature."""
    divisions = math.comb(count_wrong + count_right, count_wrong)
    return 2 * features <= CHANCE * divisions


def _condition(right: Sequence[Wrong], wrong: Sequence[Wrong], what: str) -> Finding:
    """Return a sentence on the one feature that divides the wrong cases from the right ones."""
    features = [[_features(row) for row in rows] for rows in (wrong, right)]
    common = set.intersection(*(set(one) for rows in features for one in rows)) if right else set()
    if not common or not _no_chance(len(wrong), len(right), len(common)):
        return None
    for feature in (name for name in features[0][0] if name in common):
        values = [np.array([one[feature] for one in rows]) for rows in features]
        sentence = _divides(values[0], values[1], _upper(what), feature)
        if sentence:
            return "one_condition", f"{sentence} Look at what your code does differently there."
    return None


def _condition_of_numbers(rows: Sequence[Wrong], wrong: Sequence[Wrong], what: str) -> Finding:
    """Return a sentence on what divides the wrong numbers of an array from the right ones."""
    if len(wrong) < FEWEST or any(row.truth.ndim == 0 for row in rows):
        return None
    missed = {id(row) for row in wrong}
    masks = np.concatenate([(row.wrong & (id(row) in missed)).ravel() for row in rows])
    same = [
        n
        for n in rows[0].arguments
        if all(n in r.arguments and r.arguments[n].shape == r.truth.shape for r in rows)
    ]
    features = {
        "a right value": np.concatenate([row.truth.ravel() for row in rows]),
        **{f"`{n}`": np.concatenate([row.arguments[n].ravel() for row in rows]) for n in same},
    }
    if masks.all() or not masks.any():
        return None
    if not _no_chance(int(masks.sum()), int((~masks).sum()), len(features)):
        return None
    for feature, values in features.items():
        head = f"A number in {what}"
        sentence = _divides(values[masks], values[~masks], head, feature, "place")
        if sentence:
            return "one_condition", f"{sentence} Look at what your code does differently there."
    return None


def _side(right: Sequence[Wrong], wrong: Sequence[Wrong], what: str) -> Finding:
    """Return a sentence on wrong numbers that all lie on one side of the right ones."""
    errors = np.concatenate([row.error[row.wrong] for row in wrong])
    truth = np.concatenate([row.truth[row.wrong] for row in wrong])
    numbers = np.concatenate([row.truth.ravel() for row in (*right, *wrong)])
    got = truth + errors
    if set(np.unique(numbers)) <= {0.0, 1.0} and set(np.unique(got)) <= {0.0, 1.0}:
        if len(wrong) >= FEWEST and (np.all(errors > 0.0) or np.all(errors < 0.0)):
            returned, expected = (1, 0) if errors[0] > 0.0 else (0, 1)
            return "one_sided", (
                f"Every wrong number in {what} is {returned} where {expected} is right, and none "
                f"is {expected} where {returned} is right: a condition is too "
                f"{'wide' if returned else 'narrow'}."
            )
        return None
    if len(wrong) < SIDED:
        return None
    sides = {
        "too large": np.all(errors > 0.0),
        "too small": np.all(errors < 0.0),
        "too far from zero": np.all(errors * truth > 0.0),
        "too close to zero, or beyond it": np.all(errors * truth < 0.0),
    }
    for word, holds in sides.items():
        if holds:
            nonzero = truth != 0.0
            share = np.abs(errors[nonzero] / truth[nonzero])
            amount = (
                f", by {100.0 * share.min():.3g} % to {100.0 * share.max():.3g} %"
                if nonzero.all() and share.max() < 10.0
                else ""
            )
            return "one_sided", (
                f"Every wrong number in {what} is {word}{amount}, and none is on the other side. "
                "Ask yourself what would move all of them back."
            )
    return None


def _upper(what: str) -> str:
    return what[:1].upper() + what[1:]
