"""Check a learner's formula against the right one, without running a line of what was typed.

The text goes through a tokeniser and a recursive-descent parser of our own, which know numbers,
declared symbols, a few functions and five operators. What comes out is a tree of tuples, evaluated
with mpmath at 50 digits at many points: a difference at one point proves the formula wrong, and the
point is the counter-example. Agreement at all of them is confirmed by SymPy where that is quick.

Bounds keep every text harmless: length, nesting, and the size of every intermediate value.
"""

import random
import re
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from course.derivations import markup

MAX_LENGTH = 200
MAX_DEPTH = 25
_DIGITS = 50
_AGREE = 1e-35  # relative difference below which two values at 50 digits are the same
_HUGE = 1e150
_RANDOM_POINTS = 40
_CONFIRM_SECONDS = 1.0

Node = tuple[Any, ...]
Values = dict[str, float]


@dataclass(frozen=True)
class Symbol:
    """A symbol a learner may use.

    Attributes:
        meaning: what it is, with its unit.
        low: lower end of the range in which the formula must hold.
        high: upper end of that range.
    """

    meaning: str
    low: float = 0.1
    high: float = 10.0


@dataclass(frozen=True)
class Formula:
    """What a learner is asked for.

    Attributes:
        question: the question, in words.
        expression: the right answer, in the syntax that learners use.
        symbols: name -> Symbol.
        also: further names a learner may use -> their meaning as an expression in `symbols`.
        left_sides: names that may stand alone on one side of a relation, as in `dt < ...`.
        relation: "=" for a value, "<" for an upper limit (then `dt < ...` is right and
            `dt > ...` is wrong), ">" for a lower one.
        tolerance: relative; 0 asks for the exact form, more admits a rounded number.
        slips: plausible wrong answer -> what went wrong, shown to those who give it.
    """

    question: str
    expression: str
    symbols: Mapping[str, Symbol]
    also: Mapping[str, str] = field(default_factory=dict)
    left_sides: tuple[str, ...] = ()
    relation: str = "="
    tolerance: float = 0.0
    slips: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # The step is written h in formulas and dt in code; both are understood.
        for name, other in (("h", "dt"), ("dt", "h")):
            if name in self.symbols and other not in (*self.symbols, *self.also):
                object.__setattr__(self, "also", {**self.also, other: name})

    def prompt(self) -> str:
        """Return the question and the symbols, for an answer that was not right."""
        return f"Asked: {self.question} In terms of {', '.join(self.symbols) or 'numbers'}."


@dataclass(frozen=True)
class Answer:
    """The verdict on a learner's formula.

    Attributes:
        correct: whether it is right.
        message: what to tell the learner.
        counterexample: None, or {"values": symbol -> number, "yours": number or None where it is
            not defined, "ours": number}.
        question: the question, and in which symbols; "" where that stands elsewhere.
        typed: the learner's formula as it was typed.
        topic: of the claim's chapter.
    """

    correct: bool
    message: str
    counterexample: dict[str, Any] | None = None
    question: str = ""
    typed: str = ""
    topic: str = ""

    def __bool__(self) -> bool:
        return self.correct

    def __repr__(self) -> str:
        return f"{'right' if self.correct else 'not right'}: {self.message}"

    def _repr_markdown_(self) -> str:
        # A page shows the answer without the cell that it was typed in.
        question = [markup.tex(self.question, self.topic)] if self.question else []
        typed = self.typed.replace("`", "'").strip()
        given = [f"Your answer: `{typed}`"] if typed and "\n" not in typed else []
        return "  \n".join([*question, *given, self.verdict()])

    def verdict(self) -> str:
        """Return whether it is right and why, without the question; Markdown."""
        if self.correct:
            return self.message.replace("Right", "**Right**", 1)
        # The message may quote what was typed: shown as code, it can't become markup.
        shown = self.message.replace("`", "'")
        return f"**Not right.** `{shown}`"


class _Unreadable(Exception):
    """The text is not a formula; the message is for the learner."""


class _Undefined(Exception):
    """The formula has no value at a point."""


_ALIASES = {
    "ω": " omega ",
    "ζ": " zeta ",
    "π": " pi ",
    "·": "*",
    "×": "*",
    "−": "-",
    "²": "^2",
    "³": "^3",
    "÷": "/",
    "≤": "<=",
    "≥": ">=",
}
_FUNCTIONS = ("sqrt", "exp", "log", "ln", "sin", "cos", "tan", "asin", "acos", "atan", "abs")
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9_]*)"
    r"|(?P<op>\*\*|[-+*/^()√]))",
    re.ASCII,
)


def _tokens(text: str) -> list[tuple[str, str]]:
    result = []
    position = 0
    text = text.rstrip()
    # One regular expression per token; what it does not know is refused by name.
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            shown = ascii(text[position:].lstrip()[0])[1:-1]
            raise _Unreadable(f"the character '{shown}' has no meaning in a formula here")
        kind = str(match.lastgroup)
        word = match.group(kind)
        if kind == "number" and (len(word) > 30 or not 1e-99 < (float(word) or 1.0) < 1e99):
            raise _Unreadable("a number is too long, too large or too small")
        result.append((kind, "^" if word == "**" else word))
        position = match.end()
    return result


class _Parser:
    """sum := product (± product)*; product := factor ((* | / | nothing) factor)*.

    Factor := ± factor | atom [^ factor]; atom := number | name | function (sum) | √ atom | (sum)
    """

    def __init__(self, text: str, names: frozenset[str]) -> None:
        self.tokens = [*_tokens(text), ("end", "")]
        self.position = 0
        self.depth = 0
        self.names = names

    def parse(self) -> Node:
        node = self._sum()
        kind, word = self._peek()
        if kind != "end":
            raise _Unreadable(f"did not expect '{word}' there: a bracket too many?")
        return node

    def _peek(self) -> tuple[str, str]:
        return self.tokens[self.position]

    def _take(self) -> tuple[str, str]:
        token = self.tokens[self.position]
        self.position += 1
        return token

    def _deeper(self) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise _Unreadable(f"it is nested more than {MAX_DEPTH} levels deep")

    def _sum(self) -> Node:
        self._deeper()
        node = self._product()
        while self._peek()[1] in ("+", "-"):
            node = (self._take()[1], node, self._product())
        self.depth -= 1
        return node

    def _product(self) -> Node:
        node = self._factor()
        while True:
            kind, word = self._peek()
            if word in ("*", "/"):
                self._take()
                node = (word, node, self._factor())
            # Implicit multiplication: "2 sqrt(m/k)" and "2(m/k)" need no sign between the factors.
            elif kind in ("number", "name") or word in ("(", "√"):
                node = ("*", node, self._factor())
            else:
                return node

    def _factor(self) -> Node:
        self._deeper()
        sign = self._peek()[1]
        if sign in ("+", "-"):
            self._take()
            inner = self._factor()
            node: Node = ("neg", inner) if sign == "-" else inner
        else:
            node = self._atom()
            if self._peek()[1] == "^":
                self._take()
                # The exponent is a factor again, so that powers associate to the right and "2^-1"
                # works; a sign in front of the base binds more loosely than the power.
                node = ("^", node, self._factor())
        self.depth -= 1
        return node

    def _atom(self) -> Node:
        kind, word = self._take()
        if kind == "number":
            return ("number", word)
        if kind == "name":
            if word in _FUNCTIONS and word not in self.names:
                if self._peek()[1] != "(":
                    raise _Unreadable(f"write the argument of {word} in brackets: {word}(...)")
                self._take()
                return ("call", word, self._close(self._sum()))
            if word in self.names:
                return ("name", word)
            known = ", ".join(sorted(self.names))
            raise _Unreadable(f"'{word[:20]}' is not a symbol here; the symbols are {known}")
        if word == "(":
            return self._close(self._sum())
        if word == "√":
            self._deeper()
            node = self._atom()
            self.depth -= 1
            return ("call", "sqrt", node)
        if kind == "end":
            raise _Unreadable("it stops where a number, a symbol or a bracket should follow")
        raise _Unreadable(f"did not expect '{word}' there")

    def _close(self, node: Node) -> Node:
        if self._take()[1] != ")":
            raise _Unreadable("a closing bracket is missing")
        return node


def parse(text: str, names: frozenset[str]) -> Node:
    """Read a formula.

    Args:
        text: the formula.
        names: the symbols it may use, besides pi.

    Returns:
        A tree of tuples: ("number", text), ("name", name), ("call", function, node),
        ("neg", node), (operator, node, node).

    Raises:
        ValueError: if it is not a formula in these symbols.
    """
    try:
        return _read(text, names)
    except _Unreadable as reason:
        raise ValueError(f"text is not a formula: {reason}") from None


def evaluate(text: str) -> float:
    """Return the value of arithmetic without symbols, such as "2*sqrt(1/100)".

    Args:
        text: numbers, pi, the operators and functions of a formula.

    Raises:
        ValueError: if it is not arithmetic, or its value is not a real number.
    """
    import mpmath

    node = parse(text, frozenset())
    try:
        with mpmath.workdps(_DIGITS):
            value = _real(_value(node, {}, mpmath.mp), mpmath.mp)
    except _Undefined as reason:
        raise ValueError(f"text has no value: {reason}") from None
    except (ArithmeticError, ValueError):
        raise ValueError("text has no value") from None
    if value is None:
        raise ValueError("text has no real value")
    return value


def _read(text: str, names: frozenset[str]) -> Node:
    if len(text) > MAX_LENGTH:
        raise _Unreadable(f"it has {len(text)} characters; at most {MAX_LENGTH} are read")
    for character, meaning in _ALIASES.items():
        text = text.replace(character, meaning)
    if not text.strip():
        raise _Unreadable("it is empty")
    return _Parser(text, names | {"pi"}).parse()


def _bounded(value: Any) -> Any:
    # Every intermediate value is bounded, so that no text can make the evaluation slow.
    size = abs(value)
    if not size < _HUGE:  # also catches nan
        raise _Undefined("a value becomes too large")
    return value


def _power(base: Any, exponent: Any, mp: Any) -> Any:
    if base == 0:
        if mp.re(exponent) <= 0:
            raise _Undefined("it divides by zero")
        return base
    # Checked before the power is computed: 9^9^9^9 must not be attempted.
    if abs(exponent * mp.log(base)) > 340:  # exp(340) is about _HUGE
        raise _Undefined("a power becomes too large or too small")
    return base**exponent


def _call(name: str, value: Any, mp: Any) -> Any:
    if name == "exp" and abs(value) > 340:
        raise _Undefined("an exponential becomes too large or too small")
    if name in ("log", "ln") and value == 0:
        raise _Undefined("it takes the logarithm of zero")
    if name in ("sin", "cos", "tan") and abs(mp.im(value)) > 340:
        raise _Undefined("a value becomes too large")
    return getattr(mp, {"abs": "fabs", "ln": "log"}.get(name, name))(value)


def _value(node: Node, values: Mapping[str, Any], mp: Any) -> Any:
    """Return value of the tree, every intermediate value bounded, so that nothing can take long."""
    kind = node[0]
    if kind == "number":
        return mp.mpf(node[1])
    if kind == "name":
        return +mp.pi if node[1] == "pi" and "pi" not in values else values[node[1]]
    if kind == "neg":
        return -_value(node[1], values, mp)
    if kind == "call":
        return _bounded(_call(node[1], _value(node[2], values, mp), mp))
    left, right = _value(node[1], values, mp), _value(node[2], values, mp)
    if kind == "+":
        return _bounded(left + right)
    if kind == "-":
        return _bounded(left - right)
    if kind == "*":
        return _bounded(left * right)
    if kind == "/":
        if right == 0:
            raise _Undefined("it divides by zero")
        return _bounded(left / right)
    return _bounded(_power(left, right, mp))


def _sympy(node: Node, values: Mapping[str, Any], sympy: Any) -> Any:
    """Return the tree as a SymPy expression, built node by node; no text reaches SymPy."""
    kind = node[0]
    if kind == "number":
        return sympy.Rational(node[1])
    if kind == "name":
        return sympy.pi if node[1] == "pi" and "pi" not in values else values[node[1]]
    if kind == "neg":
        return -_sympy(node[1], values, sympy)
    if kind == "call":
        name = {"abs": "Abs", "ln": "log"}.get(str(node[1]), str(node[1]))
        return getattr(sympy, name)(_sympy(node[2], values, sympy))
    left, right = _sympy(node[1], values, sympy), _sympy(node[2], values, sympy)
    if kind == "^":
        # SymPy would expand large powers; the numerical comparison handles those.
        if not (right.is_Rational and abs(right) <= 12):
            raise _Undefined("only small powers are worth confirming")
        return left**right
    operations: dict[str, Callable[[], Any]] = {
        "+": lambda: left + right,
        "-": lambda: left - right,
        "*": lambda: left * right,
        "/": lambda: left / right,
    }
    return operations[kind]()


def to_sympy(formula: Formula) -> Any:
    """Return the right answer as a SymPy expression in symbols of the declared names and signs.

    Args:
        formula: the formula that the learner is asked for.
    """
    import sympy

    return _sympy(
        _read(formula.expression, frozenset(formula.symbols)), _sympy_symbols(formula), sympy
    )


def _sympy_symbols(formula: Formula) -> dict[str, Any]:
    import sympy

    return {
        name: sympy.Symbol(name, positive=True) if s.low >= 0 else sympy.Symbol(name, real=True)
        for name, s in formula.symbols.items()
    }


def _points(formula: Formula) -> Iterator[Values]:
    """Round numbers first, so that a counter-example reads well; then random ones."""
    # Seeded with the formula: a learner who tries again sees the same counter-example.
    generator = random.Random(formula.expression)  # the same points every time
    for nice in (1.0, 2.0, 3.0, 0.5, 4.0):
        point = {}
        for i, (name, symbol) in enumerate(formula.symbols.items()):
            value = nice * (1 + i)
            inside = symbol.low < value < symbol.high
            point[name] = value if inside else (symbol.low + symbol.high * (1 + i)) / (2 + i)
        yield point
    for _ in range(_RANDOM_POINTS):
        yield {
            name: round(generator.uniform(s.low, s.high), 6) for name, s in formula.symbols.items()
        }


def _all_values(formula: Formula, point: Values, mp: Any) -> dict[str, Any]:
    values = {name: mp.mpf(value) for name, value in point.items()}
    names = frozenset(formula.symbols)
    further = {name: _value(_read(e, names), values, mp) for name, e in formula.also.items()}
    return values | further


def _real(value: Any, mp: Any) -> float | None:
    # Intermediate roots may be complex; a value counts as real if its imaginary part is rounding.
    return float(mp.re(value)) if abs(mp.im(value)) <= _AGREE * abs(value) else None


def _difference(formula: Formula, theirs: Node) -> tuple[dict[str, Any], str] | None:
    """Return a point at which the two differ, and how; None if they agree everywhere."""
    import mpmath

    mp = mpmath.mp
    right = _read(formula.expression, frozenset(formula.symbols))
    allowed = max(formula.tolerance, _AGREE)
    defined = 0
    with mpmath.workdps(_DIGITS):
        for point in _points(formula):
            values = _all_values(formula, point, mp)
            ours = _value(right, values, mp)
            reason = ""
            yours = None
            try:
                value = _value(theirs, values, mp)
                defined += 1
                # Relative, but absolute where the right value is 0.
                if abs(value - ours) <= allowed * (abs(ours) or 1):
                    continue
                yours = _real(value, mp)
                if yours is None:
                    reason = "is not a real number"
            except _Undefined as undefined:
                reason = f"has no value: {undefined}"
            except (ArithmeticError, ValueError):
                reason = "has no value"
            return {"values": point, "yours": yours, "ours": _real(ours, mp)}, reason
    return None


@contextmanager
def _deadline(seconds: float) -> Iterator[None]:
    def give_up(*_: object) -> None:
        raise TimeoutError

    # Processor time: on a machine that is busy elsewhere the same proofs are found.
    previous = signal.signal(signal.SIGVTALRM, give_up)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, previous)


def _may_interrupt() -> bool:
    """Return whether a slow proof can be interrupted here: only the main thread has an alarm."""
    return (
        hasattr(signal, "SIGVTALRM")
        and threading.current_thread() is threading.main_thread()
        and signal.getitimer(signal.ITIMER_VIRTUAL)[0] == 0
    )


def _proved(formula: Formula, theirs: Node) -> bool:
    """Return whether SymPy proves the two equal within a second of processor time."""
    if formula.tolerance or not _may_interrupt():
        return False
    import sympy

    symbols = _sympy_symbols(formula)
    try:
        # simplify has no bound on its time, so an alarm ends it.
        with _deadline(_CONFIRM_SECONDS):
            names = frozenset(formula.symbols)
            also = {k: _sympy(_read(e, names), symbols, sympy) for k, e in formula.also.items()}
            right = _sympy(_read(formula.expression, names), symbols, sympy)
            return bool(sympy.simplify(_sympy(theirs, symbols | also, sympy) - right) == 0)
    except (TimeoutError, _Undefined, ArithmeticError, ValueError, RecursionError):
        return False


_RELATION = re.compile(r"<=|>=|<|>|=")


def _strip_relation(formula: Formula, text: str) -> str:
    """Return the side of `dt < ...` that holds the formula."""
    text = text[: MAX_LENGTH + 1].replace("≤", "<=").replace("≥", ">=")
    for character in ("ω", "ζ", "π"):
        text = text.replace(character, _ALIASES[character])
    signs = _RELATION.findall(text)
    if not signs:
        return text
    if len(signs) > 1:
        raise _Unreadable("it has more than one relation sign; write one formula")
    sides = [side.strip() for side in _RELATION.split(text)]
    sign = signs[0]
    allowed = ", ".join(formula.left_sides) or "nothing"
    if sides[0] in formula.left_sides:
        rest = sides[1]
    elif sides[1] in formula.left_sides:
        rest = sides[0]
        # "2/omega > dt" is the same limit written from the right.
        sign = sign.translate(str.maketrans("<>", "><"))
    else:
        raise _Unreadable(f"one side must be a single name (here: {allowed})")
    if formula.relation in "<>" and sign[0] in "<>" and sign[0] != formula.relation:
        kind, other = ("upper", "lower") if formula.relation == "<" else ("lower", "upper")
        raise _Unreadable(
            f"it is an {kind} limit, and you wrote the {other} one: turn the sign round"
        )
    if formula.relation == "=" and sign != "=":
        raise _Unreadable("it is a value, not a limit: write it with =, or only the right side")
    return rest


def _describe(result: dict[str, Any], reason: str) -> str:
    at = ", ".join(f"{name} = {value:g}" for name, value in result["values"].items())
    where = f"With {at}" if at else "As a number"
    if reason:
        return f"{where}: yours {reason}, the right one gives {result['ours']:.6g}."
    yours, ours = result["yours"], result["ours"]
    # As many digits as it takes for the two numbers to look different.
    digits = next((n for n in range(6, 17) if f"{yours:.{n}g}" != f"{ours:.{n}g}"), 17)
    message = f"{where}: yours gives {yours:.{digits}g}, the right one gives {ours:.{digits}g}."
    if abs(yours - ours) < 1e-3 * abs(ours):
        message += " If you rounded a number: write it exactly, such as sqrt(2) or 1/3."
    return message


def answer_formula(formula: Formula, text: str) -> Answer:
    """Check a learner's formula.

    Args:
        formula: the formula that is asked for.
        text: what the learner typed.

    Returns:
        Whether it is right, a message, and a counter-example if it is wrong.

    Raises:
        ValueError: if text is not a str.
    """
    if not isinstance(text, str):
        raise ValueError(f"text is a {type(text).__name__}; it must be a str")
    names = frozenset(formula.symbols) | frozenset(formula.also)
    try:
        if len(text) > MAX_LENGTH:
            raise _Unreadable(f"it has {len(text)} characters; at most {MAX_LENGTH} are read")
        theirs = _read(_strip_relation(formula, text), names)
    except _Unreadable as problem:
        return Answer(False, f"I can't read that: {problem}. {formula.prompt()}")
    difference = _difference(formula, theirs)
    if difference is None:
        how = "SymPy proves the two equal" if _proved(formula, theirs) else "checked at 45 points"
        how = "within the rounding allowed" if formula.tolerance else how
        return Answer(True, f"Right ({how}).")
    result, reason = difference
    message = _describe(result, reason)
    for slip, explanation in formula.slips.items():
        if _same(formula, theirs, slip):
            message = f"{message} {explanation}"
            break
    else:
        message = f"{message} {formula.prompt()}"
    return Answer(False, message, result)


def _same(formula: Formula, theirs: Node, slip: str) -> bool:
    other = replace(formula, expression=slip)
    return _difference(other, theirs) is None


def equivalent(formula: Formula, expression: Any) -> bool:
    """Return whether a SymPy expression, in symbols named as declared, is the right answer.

    Args:
        formula: the formula that a learner is asked for.
        expression: SymPy expression that a check derived.
    """
    import mpmath

    symbols = {symbol.name: symbol for symbol in expression.free_symbols}
    if not set(symbols) <= set(formula.symbols):
        return False
    right = _read(formula.expression, frozenset(formula.symbols))
    with mpmath.workdps(_DIGITS):
        for point in _points(formula):
            values = {symbols[name]: value for name, value in point.items() if name in symbols}
            derived = expression.evalf(_DIGITS, subs=values)
            ours = _value(right, {k: mpmath.mpf(v) for k, v in point.items()}, mpmath.mp)
            if abs(mpmath.mpmathify(derived) - ours) > max(formula.tolerance, 1e-25) * abs(ours):
                return False
    return True
