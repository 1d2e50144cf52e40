"""What a check found: handed to the check empty; the verdict follows from what it holds then."""

import functools
import math
import zlib
from collections.abc import Iterable
from enum import Enum
from typing import Any

MIN_DRAWS = 8


class Verdict(Enum):
    """How a common claim fares."""

    HOLDS = "holds"
    CONDITIONAL = "holds only if"
    FALSE = "false"


def _fact(where: str, value: Any) -> bool:
    """Return a truth value; reject a number or an array that merely happens to be truthy."""
    if type(value).__name__ not in ("bool", "bool_", "BooleanTrue", "BooleanFalse"):
        raise ValueError(f"{where} got {value!r}; a fact is a bool")
    return bool(value)


class Result:
    """What a check found; the check fills it.

    Attributes:
        id: of the claim.
        figures: name -> number, or short text; the name ends in the unit where there is one.
        tolerances: name -> tolerance of a figure, relative, absolute where the figure is 0; text
            must agree exactly.
        inputs: name -> what the experiment was given and the texts may quote.
        statement: what was computed or measured, in one or two sentences.
        formula: the SymPy expression the check derived, where the claim asks for a formula.
        holds: whether the claim is true as stated; None until `statement_holds` was called.
        condition: what must be true for it to hold, or "".
        inside, outside: how the claim fared at draws inside and just outside its condition.
        facts: what settles the corrected statement.
    """

    def __init__(self, id: str) -> None:
        self.id = id
        self.figures: dict[str, float | str] = {}
        self.tolerances: dict[str, float] = {}
        self.inputs: dict[str, float | str] = {}
        self.statement = ""
        self.formula: Any = None
        self.holds: bool | None = None
        self.condition = ""
        self.inside: list[bool] = []
        self.outside: list[bool] = []
        self.facts: list[bool] = []
        self._wrong: list[str] = []

    @functools.cached_property
    def rng(self) -> Any:
        """A NumPy generator for draws; its seed is the claim's id, so every run draws the same."""
        import numpy as np

        return np.random.default_rng(zlib.crc32(self.id.encode()))

    def input(self, name: str, value: Any) -> Any:
        """Return a number that goes into the experiment and that the texts may quote as `{name}`.

        Args:
            name: ends in the unit.
            value: a number or short text; use what is returned.
        """
        self._name(name)
        self.inputs[name] = value if isinstance(value, str) else float(value)
        return value

    def measure(self, name: str, value: Any, tolerance: float = 1e-6) -> Any:
        """Record a figure that came out, and return it.

        Args:
            name: ends in the unit where there is one; the texts may quote it as `{name:.3g}`.
            value: a number, or short text.
            tolerance: by how much it may differ between machines: relative, absolute where the
                figure on record is 0.

        Returns:
            The value.
        """
        self._name(name)
        if not 0 <= tolerance <= 0.5:  # beyond it a figure says nothing
            raise ValueError(f"tolerance of {name} must be from 0 to 0.5, got {tolerance}")
        text = isinstance(value, str)
        self.figures[name] = value if text else float(value)
        self.tolerances[name] = 0.0 if text else tolerance
        return value

    def _name(self, name: str) -> None:
        if not name.isidentifier() or name == "formula":
            raise ValueError(f"name must be in snake_case and not 'formula', got {name!r}")
        if name in self.figures or name in self.inputs:
            raise ValueError(f"name must be one that is not taken, got {name!r}")

    def statement_holds(
        self,
        holds: Any,
        *,
        only_if: str = "",
        inside: Iterable[Any] = (),
        outside: Iterable[Any] = (),
        cases: bool = False,
    ) -> None:
        """Record whether the claim holds as it is stated; call it once.

        Args:
            holds: the claim in general.
            only_if: the condition under which it does hold; may quote figures.
            inside: the claim tried at random draws that meet the condition: all must hold.
            outside: the claim tried at draws that just fail it: some must fail.
            cases: the condition names a few cases instead of a range (methods, engines), so that
                fewer than 8 draws are all there are.
        """
        if self.holds is not None:
            raise ValueError("statement_holds was called twice; a claim has one verdict")
        self.holds = _fact("statement_holds", holds)
        self.condition = only_if
        self.inside = [_fact("inside", x) for x in inside]
        self.outside = [_fact("outside", x) for x in outside]
        if not only_if:
            if self.inside or self.outside:
                self._wrong.append("draws were given without a condition")
            return
        least = 1 if cases else MIN_DRAWS
        for side, draws in (("inside", self.inside), ("outside", self.outside)):
            if len(draws) < least:
                self._wrong.append(f"{len(draws)} draws {side} the condition; at least {least}")
        if self.holds:
            self._wrong.append("a condition was given, and yet the claim holds in general")
        if not all(self.inside):
            failed, count = self.inside.count(False), len(self.inside)
            self._wrong.append(f"the condition is not enough: {failed} of {count} draws in it fail")
        if self.outside and all(self.outside):
            self._wrong.append(
                f"the condition is not needed: all {len(self.outside)} draws outside it hold"
            )

    def correction_holds(self, *facts: Any) -> None:
        """What settles the corrected statement; all must be true, and each must be computed."""
        self.facts += [_fact("correction_holds", fact) for fact in facts]

    @property
    def verdict(self) -> Verdict:
        """The verdict that follows from what was found."""
        if self.holds:
            return Verdict.HOLDS
        retained = self.condition and self.inside and all(self.inside)
        return Verdict.CONDITIONAL if retained else Verdict.FALSE

    def problems(self) -> list[str]:
        """Return the faults of a result, whatever its record says."""
        wrong = list(self._wrong)
        if self.holds is None:
            wrong.append("the check did not say whether the claim holds (result.statement_holds)")
        if not self.facts:
            wrong.append("nothing settles the corrected statement (result.correction_holds)")
        false = [str(i + 1) for i, fact in enumerate(self.facts) if not fact]
        if false:
            wrong.append(
                f"the corrected statement does not hold: fact {', '.join(false)} "
                f"of {len(self.facts)} is false"
            )
        if not self.figures:
            wrong.append("there is no figure; a claim is settled by a figure")
        if not self.statement:
            wrong.append("there is no statement of what was computed or measured")
        wrong += [
            f"{k} is {v}, not a number"
            for k, v in self.figures.items()
            if isinstance(v, float) and math.isnan(v)
        ]
        return wrong
