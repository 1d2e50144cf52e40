"""Two rules that keep a claim honest: no fact is a constant, and no number in a text is typed.

`constants` reads a check's syntax tree. A fact, a draw or a figure counts as computed if it can be
traced to a call that computes something; looking at literals (`all`, `abs`, `np.isclose`, ...) is
none. `typed_numbers` reads a text.
"""

import ast
import inspect
import re
import textwrap
from collections import defaultdict
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

# What only looks at, or arranges, what it is given.
_LOOKS = frozenset(
    "abs all any bool dict divmod enumerate float frozenset int isinstance len list max min next "
    "pow range repr reversed round set sorted str sum tuple zip Fraction "
    "allclose array array_equal arange asarray concatenate count_nonzero full hypot isclose "
    "isfinite isnan isinf linspace logical_and logical_not logical_or ones repeat stack tile zeros "
    "all any items keys values get copy tolist astype item mean index count format join".split()
)
_ADDS = frozenset("append extend add update insert setdefault".split())
_COMPUTES = ast.Pass()  # stands for "this name was imported"


class _Check:
    """A check's syntax tree, and where each of its names comes from."""

    def __init__(self, function: Callable[..., Any]) -> None:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        if not isinstance(tree, ast.FunctionDef) or len(tree.args.args) != 1:
            raise ValueError("a check is a function of one argument, the result")
        self.body = tree.body
        self.result = tree.args.args[0].arg
        self.outer = function.__globals__
        self.sources: dict[str, list[ast.AST]] = defaultdict(list)
        for statement in self.body:
            for node in ast.walk(statement):
                self._note(node)

    def _bind(self, target: ast.AST, value: ast.AST) -> None:
        for node in ast.walk(target):
            if isinstance(node, ast.Name):
                self.sources[node.id].append(value)

    def _note(self, node: ast.AST) -> None:
        if isinstance(node, ast.Assign):
            for target in node.targets:
                self._bind(target, node.value)
        elif isinstance(node, ast.AnnAssign | ast.AugAssign | ast.NamedExpr):
            if node.value is not None:
                self._bind(node.target, node.value)
        elif isinstance(node, ast.For | ast.comprehension):
            self._bind(node.target, node.iter)
        elif isinstance(node, ast.withitem) and node.optional_vars is not None:
            self._bind(node.optional_vars, node.context_expr)
        elif isinstance(node, ast.FunctionDef):
            inside = list(ast.walk(node))
            returns = [x.value for x in inside if isinstance(x, ast.Return | ast.Yield) and x.value]
            self.sources[node.name] += returns
            if len(returns) > 1:  # what chooses between them counts
                self.sources[node.name] += [x.test for x in inside if isinstance(x, ast.If)]
        elif isinstance(node, ast.Import | ast.ImportFrom):
            for alias in node.names:
                self.sources[alias.asname or alias.name.split(".")[0]].append(_COMPUTES)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            if node.func.attr in _ADDS and isinstance(node.func.value, ast.Name):
                self.sources[node.func.value.id] += [
                    *node.args,
                    *(keyword.value for keyword in node.keywords),
                ]

    def calls(self, name: str) -> Iterator[ast.Call]:
        """Yield calls of a method of the result."""
        for statement in self.body:
            for node in ast.walk(statement):
                if isinstance(node, ast.Call) and self.is_result(node.func, name):
                    yield node

    def is_result(self, node: ast.AST, name: str | None = None) -> bool:
        """Return whether a node is an attribute of the result (of this name)."""
        return (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == self.result
            and name in (None, node.attr)
        )

    def computed(self, value: ast.AST, observed: frozenset[str] = frozenset()) -> bool:
        """Return whether a value can be traced to a call that computes something."""
        if value is _COMPUTES:
            return True
        for node in ast.walk(value):
            if isinstance(node, ast.Call) and self._computes(node.func):
                return True
            if isinstance(node, ast.Name) and node.id not in observed:
                if node.id in self.sources:
                    further = observed | {node.id}
                    if any(self.computed(source, further) for source in self.sources[node.id]):
                        return True
                elif self._outer_computes(node.id):
                    return True
        return False

    def _outer_computes(self, name: str) -> bool:
        """Return whether an outer function or module of the file computes anything.

        Constants do not count as computing.
        """
        value = self.outer.get(name)
        if isinstance(value, ModuleType):
            return value.__name__.split(".")[0] not in ("numpy", "math")
        if not callable(value) or isinstance(value, type) or name in _LOOKS:
            return False
        return not _returns_a_literal(value)

    def _computes(self, function: ast.AST) -> bool:
        if isinstance(function, ast.Name):
            return function.id not in self.sources and self._outer_computes(function.id)
        if isinstance(function, ast.Attribute):
            root: ast.AST = function
            while isinstance(root, ast.Attribute):
                root = root.value
            if not isinstance(root, ast.Name) or root.id == self.result:
                return False
            outer = isinstance(self.outer.get(root.id), ModuleType)
            return outer and root.id not in self.sources and function.attr not in _LOOKS
        return False

    def excuses(self, value: ast.AST) -> bool:
        """Return whether a fact holds a literal True or False, or compares a thing with itself."""
        if isinstance(value, ast.Constant):
            return isinstance(value.value, bool)
        if isinstance(value, ast.Compare) and len(value.comparators) == 1:
            if ast.dump(value.left) == ast.dump(value.comparators[0]):
                return True
        if isinstance(value, ast.Call):
            name = getattr(value.func, "attr", getattr(value.func, "id", ""))
            return name in _LOOKS and any(self.excuses(argument) for argument in value.args)
        return any(self.excuses(child) for child in ast.iter_child_nodes(value))


def _returns_a_literal(function: Callable[..., Any]) -> bool:
    """Return whether a function can return one thing only, which is written there."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, TypeError, SyntaxError):  # a builtin, something compiled, a lambda
        return False
    values = [node.value for node in ast.walk(tree) if isinstance(node, ast.Return) and node.value]
    if len({ast.dump(value) for value in values}) != 1:  # none, or it chooses
        return False
    return not any(isinstance(node, ast.Name | ast.Call) for node in ast.walk(values[0]))


def constants(function: Callable[..., Any]) -> list[str]:
    """Return the figures that a check reports without computing them, one sentence each.

    Args:
        function: a check.
    """
    check = _Check(function)
    wrong = []
    whole = ast.Module(body=check.body, type_ignores=[])
    held = {
        id(node.value)
        for node in ast.walk(whole)
        if isinstance(node, ast.Attribute) and check.is_result(node)
    }
    for node in ast.walk(whole):
        if isinstance(node, ast.Name) and node.id == check.result and id(node) not in held:
            wrong.append(f"{check.result} is handed on; call its methods in the check itself")
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            if check.is_result(node.value.func, "input"):
                wrong.append(f"{ast.unparse(node)} is not used; what is given must go in")
    for name, what in (("correction_holds", "fact"), ("statement_holds", "verdict")):
        calls = list(check.calls(name))
        if not calls:
            wrong.append(f"the check calls no {check.result}.{name}")
        for call in calls:
            draws = [k.value for k in call.keywords if k.arg in ("inside", "outside")]
            for value in [*call.args, *draws]:
                if not check.computed(value) or check.excuses(value):
                    wrong.append(f"a {what} is constant, not computed: {ast.unparse(value)}")
    for call in check.calls("measure"):
        if len(call.args) > 1 and not check.computed(call.args[1]):
            wrong.append(
                f"a figure is typed, not computed: {ast.unparse(call)}; what goes into the "
                f"experiment is {check.result}.input(name, value)"
            )
    return wrong


_UNITS = (
    "m mm um cm km s ms us ns min h g kg t N kN MN Nm J mJ kJ W kW Pa kPa MPa GPa Hz kHz MHz GHz "
    "V A K rad mrad deg px B kB MB GB bits fps rpm ppm metres? seconds? degrees? radians? joules? "
    "newtons? hertz millimetres? milliseconds? microseconds? hours? minutes?"
).split()
_FIELD = re.compile(r"\{[^{}]*\}")
_NAME = re.compile(r"\b[A-Z]{2,}[- ]\d+")  # ISO 10218
_NUMBER = re.compile(r"(?<![\w.])(?:\d+(?:,\d{3})*)?(?P<measured>(?:\.\d+)?(?:e[+-]?\d+)?)(?<=\d)")
_AFTER = re.compile(
    r"\s?(?:%|‰|°|per\s?cent\b|percent\b)"
    # A unit ends a phrase or stands before a word; before a letter it is a symbol: 2 m g h.
    rf"|[ -](?:{'|'.join(_UNITS)})(?:[/^*]\w+)*(?=$|[,.;:)]|\s+[a-zA-Z]{{2}})"
)


def typed_numbers(text: str) -> list[str]:
    """Return numbers in a text that should be fields: `{name:.3g}`.

    A decimal point, a power of ten, a percentage, a unit, or two digits and more make a number of
    the measured kind. Small whole numbers and those that stand beside an operator (`u^4 / 24`)
    belong to words and formulas.
    """
    text = _NAME.sub("", _FIELD.sub("x", text))
    typed = []
    for match in _NUMBER.finditer(text):
        number, left, right = match.group(), text[: match.start()], text[match.end() :]
        unit = _AFTER.match(right)
        in_formula = left.rstrip()[-1:] in ("*", "/", "^", "+") or right.lstrip()[:1] in (*"*/^",)
        power = number == "10" and right.lstrip().startswith("^")
        long = len(number) > 1 and not in_formula
        if match["measured"] or "," in number or unit or power or long:
            typed.append(number + (unit.group() if unit else ""))
    return typed
