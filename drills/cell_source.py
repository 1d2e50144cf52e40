"""The source of a definition made in a notebook, with what it borrows from other cells.

A submission is graded as a file of its own. So the definition is taken from its cell together with
what it uses: imports become import lines, functions and classes of other cells come along as
source, plain numbers and texts as literals. Anything else can't be carried, and is named.
"""

from __future__ import annotations

import ast
import builtins
import linecache
import math
import symtable
import sys
import types
from dataclasses import dataclass, field
from typing import Any, TypeGuard

_LONGEST = 2000  # characters of a literal
_OWN = ("course", "drills", "solutions")


class Unusable(Exception):
    """There is no source to grade; the message says what to do."""


class Borrowed(Exception):
    """A name can't come along; the message names it and says what to do."""


@dataclass
class Assembled:
    """A submission put together from cells.

    Attributes:
        source: the text to grade.
        entry: the name of what is graded.
        carried: what came along from other cells: a name and what it is.
    """

    source: str
    entry: str
    carried: list[str] = field(default_factory=list)


def assemble(obj: Any) -> Assembled:
    """Return the source of a function or class, with what it borrows.

    Args:
        obj: as it was defined in a cell, or in a file.

    Raises:
        Unusable: obj isn't a function or class with a source.
        Borrowed: it uses something that can't be carried.
    """
    obj = _bare(obj)
    if not isinstance(obj, types.FunctionType | type):
        given = type(obj).__name__
        raise Unusable(
            f"check takes the function or the class itself, not a value of type {given}: "
            "check(my_function), without calling it."
        )
    return _Assembly(obj).result()


def defined_by(obj: Any) -> str:
    """Return the name under which an object was defined."""
    return str(getattr(_bare(obj), "__name__", ""))


def own_source(obj: Any) -> str:
    """Return the definition alone, without what it borrows; "" if there is none."""
    obj = _bare(obj)
    try:
        cell, node = _located(obj, obj.__name__)
    except (Unusable, AttributeError):
        return ""
    return cell.text(node) + "\n"


def _bare(obj: Any) -> Any:
    """Return an object without the wrappers of a compiler, a cache, or another decorator.

    A decorator counts as one if it says what it wraps.
    """
    visited: set[int] = set()
    while id(obj) not in visited and not isinstance(obj, type):
        visited.add(id(obj))
        obj = getattr(obj, "py_func", getattr(obj, "__wrapped__", obj))
    return obj


@dataclass(frozen=True)
class _Cell:
    """A cell or file: its syntax tree and lines."""

    filename: str
    body: list[ast.stmt]
    lines: list[str]

    def text(self, node: ast.stmt) -> str:
        """Return the lines of a statement, without others that share its first or last line."""
        lines = [line.encode() for line in self.lines[_first_line(node) - 1 : node.end_lineno]]
        lines[-1] = lines[-1][: node.end_col_offset]
        lines[0] = lines[0][node.col_offset :] if len(lines) == 1 else lines[0]
        return b"\n".join(lines).decode()


class _Assembly:
    """Collects definitions until no name is missing.

    What stands in the cell of the graded definition keeps its line, so that a message about line 7
    means line 7 of the cell. What comes from elsewhere goes into a free first line or to the end:
    a name that is only used when the function runs may be bound after it.
    """

    def __init__(self, obj: Any) -> None:
        self.obj = obj
        self.home, self.node = _located(obj, obj.__name__)
        self.statements: list[ast.stmt] = []  # statements of the home cell
        self.simple: list[str] = []  # imports and literals, one line each
        self.carried: list[str] = []
        self.done: set[str] = set()
        self.early: set[str] = set()  # names needed while the cell is run from top to bottom
        self.sources: dict[str, str] = {}  # definitions of other cells
        self.uses: dict[str, set[str]] = {}  # and the names that each of them uses
        self.annotated = False  # whether one of them has annotations

    def result(self) -> Assembled:
        name = self.obj.__name__
        self.done.add(name)
        self._add(self.node)
        self._needs(self.node, self.home, _namespace(self.obj), name)
        return Assembled(self._layout(), name, self.carried)

    def _layout(self) -> str:
        lines: list[list[str]] = [[] for _ in self.home.lines]
        for node in sorted(self.statements, key=lambda n: (n.lineno, n.col_offset)):
            for number, text in enumerate(self.home.text(node).split("\n"), _first_line(node) - 1):
                lines[number].append(text)
        first_is_free = not any(_first_line(n) == 1 and _is_compound(n) for n in self.statements)
        while late := [n for n in self.early & self.uses.keys() if not self.uses[n] <= self.early]:
            self.early = self.early.union(*(self.uses[name] for name in late))
        before = [text for name, text in self.sources.items() if name in self.early]
        after = [text for name, text in self.sources.items() if name not in self.early]
        simple = list(dict.fromkeys(self.simple))
        annotated = self.annotated or any(map(_is_annotated, self.statements))
        needed_first = annotated or any(_bound(line) & self.early for line in simple)
        body = "\n".join("; ".join(parts) for parts in lines)
        head = ["from __future__ import annotations", *simple]
        if before:
            return "\n\n\n".join(["\n".join(head), *before, body, *after]) + "\n"
        if first_is_free:
            first, _, rest = body.partition("\n")
            body = "; ".join([*head, *([first] if first else [])]) + "\n" + rest
            return "\n\n\n".join([body, *after]) + "\n"
        if needed_first:
            return "\n\n\n".join(["; ".join(head) + "\n" + body, *after]) + "\n"
        return "\n\n\n".join([body, "\n".join(simple), *after]) + "\n"

    def _add(self, node: ast.stmt) -> None:
        if node not in self.statements:
            self.statements.append(node)
            self.early |= _names_when_run(node)

    def _helper(self, alias: str, obj: Any, names: dict[str, Any]) -> None:
        """Bring along a function or class, and what it uses."""
        name = obj.__name__
        if name == "<lambda>":
            self._lambda(alias, obj, names)
            return
        cell, node = _located(obj, name)
        at_home = cell.filename == self.home.filename
        if at_home:
            self._add(node)
        self._needs(node, cell, _namespace(obj), name)
        extra = f"{alias} = {name}" if alias != name else ""
        if not at_home:
            self.sources[alias] = cell.text(node) + ("\n\n\n" + extra if extra else "")
            self.uses[alias] = _global_names(node)
            self.annotated |= _is_annotated(node)
            self.carried.append(alias)
        elif extra:
            self.sources[alias] = extra

    def _lambda(self, name: str, function: types.FunctionType, names: dict[str, Any]) -> None:
        cell = _cell(function.__code__.co_filename)
        node = _assignment(cell, name) if cell else None
        if cell is None or node is None:
            raise Unusable(name)
        self._needs(node, cell, names, name)
        self.sources[name] = cell.text(node)
        self.uses[name] = _global_names(node)
        self.carried.append(name)

    def _needs(self, node: ast.stmt, cell: _Cell, names: dict[str, Any], user: str) -> None:
        for name in sorted(_global_names(node)):
            if name not in self.done:
                self.done.add(name)
                self._carry(name, node, cell, names, user)

    def _carry(
        self, name: str, node: ast.stmt, cell: _Cell, names: dict[str, Any], user: str
    ) -> None:
        at_home = cell.filename == self.home.filename
        imported = _import_of(cell, name)
        if imported is not None and not _is_own(imported[1]):
            if at_home and len(imported[0].names) == 1:
                self._add(imported[0])
            else:
                self.simple.append(imported[1])
            self._submodules(name, node, names)
            return
        assigned = _assignment(cell, name)
        if assigned is not None and at_home:
            self._add(assigned)
            self._needs(assigned, cell, names, user)
            return
        if name not in names:
            return  # a builtin, or a NameError that the grading will show
        value = names[name]
        if hasattr(builtins, name) and not _is_theirs(value):
            return  # such as the notebook's own open and exit
        if isinstance(value, types.ModuleType):
            self._module(name, value, user)
            self._submodules(name, node, names)
        elif (text := _literal(value)) is not None:
            self.simple.append(f"{name} = {text}")
            self.carried.append(f"{name} = {text if len(text) <= 40 else text[:37] + '...'}")
        elif (origin := _importable(value)) is not None:
            module, original = origin
            if module.partition(".")[0] in _OWN:
                raise Borrowed(_own_sentence(name, module, user))
            alias = f" as {name}" if name != original else ""
            self.simple.append(f"from {module} import {original}{alias}")
        elif isinstance(_bare(value), types.FunctionType | type):
            try:
                self._helper(name, _bare(value), names)
            except Unusable:
                raise Borrowed(
                    f"{user} uses {name}, whose source was not found. The answer is graded on its "
                    f"own: define {name} in the cell of {user}, at its top level."
                ) from None
        else:
            raise Borrowed(
                f"{user} uses {name}, a value of type {type(value).__name__} that is defined in "
                f"another cell. The answer is graded on its own: define {name} in the cell of "
                f"{user} or inside it, or hand it in as an argument."
            )

    def _module(self, name: str, module: types.ModuleType, user: str) -> None:
        real = module.__name__
        if real.partition(".")[0] in _OWN:
            raise Borrowed(_own_sentence(name, real, user))
        if not _is_installed(module):
            raise Borrowed(
                f"{user} uses {name}, a module of your own. The answer is graded on its own: copy "
                f"what it needs of {name} into the cell of {user}."
            )
        self.simple.append(f"import {real}" if name == real else f"import {real} as {name}")

    def _submodules(self, name: str, node: ast.stmt, names: dict[str, Any]) -> None:
        """Import what is reached through a package, such as scipy.optimize."""
        top = names.get(name)
        if not isinstance(top, types.ModuleType):
            return
        for inner in ast.walk(node):
            if isinstance(inner, ast.Attribute) and isinstance(inner.value, ast.Name):
                path = f"{top.__name__}.{inner.attr}"
                if inner.value.id == name and isinstance(sys.modules.get(path), types.ModuleType):
                    self.simple.append(f"import {path}")


def _located(obj: Any, name: str) -> tuple[_Cell, ast.stmt]:
    """Return the cell of a function or class, and its definition there."""
    if "<locals>" in obj.__qualname__:
        raise Unusable(
            f"{name} is defined inside another function. Define it at the top level of a cell."
        )
    if name == "<lambda>":
        raise Unusable("A lambda has no name to grade. Write it as def NAME(...).")
    codes = _codes(obj)
    for filename in dict.fromkeys([*(code.co_filename for code in codes), *_recent_cells()]):
        cell = _cell(filename)
        if cell is None:
            continue
        fitting = [
            node
            for node in cell.body
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name
        ]
        if not fitting:
            continue
        lines = {code.co_firstlineno for code in codes if code.co_filename == filename}
        exact = [node for node in fitting if any(_spans(node, line) for line in lines)]
        return cell, (exact or fitting)[-1]
    raise Unusable(
        f"The source of {name} was not found. Run the cell that defines it again, without a cell "
        "magic such as %%time, then check."
    )


def _first_line(node: ast.stmt) -> int:
    if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.decorator_list:
        return node.decorator_list[0].lineno
    return node.lineno


def _is_compound(node: ast.stmt) -> bool:
    return isinstance(node, ast.FunctionDef | ast.ClassDef)


def _is_annotated(node: ast.stmt) -> bool:
    return any(
        isinstance(inner, ast.AnnAssign)
        or (isinstance(inner, ast.FunctionDef) and inner.returns is not None)
        or (isinstance(inner, ast.arg) and inner.annotation is not None)
        for inner in ast.walk(node)
    )


def _names_when_run(node: ast.stmt) -> set[str]:
    """Return the names that a statement uses when it is run itself: what is in functions waits."""
    if not isinstance(node, ast.FunctionDef | ast.ClassDef):
        return _global_names(node)
    used = {n.id for outer in node.decorator_list for n in ast.walk(outer) if _is_name(n)}
    if isinstance(node, ast.FunctionDef):
        defaults = [*node.args.defaults, *filter(None, node.args.kw_defaults)]
        return used | {n.id for outer in defaults for n in ast.walk(outer) if _is_name(n)}
    bases = [*node.bases, *(keyword.value for keyword in node.keywords)]
    used |= {n.id for outer in bases for n in ast.walk(outer) if _is_name(n)}
    return used.union(*map(_names_when_run, node.body))


def _is_name(node: ast.AST) -> TypeGuard[ast.Name]:
    return isinstance(node, ast.Name)


def _bound(line: str) -> set[str]:
    """Return the names that an import or an assignment binds."""
    node = ast.parse(line).body[0]
    if isinstance(node, ast.Import | ast.ImportFrom):
        return {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
    return {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}


def _spans(node: ast.stmt, line: int) -> bool:
    return _first_line(node) <= line <= (node.end_lineno or node.lineno)


def _codes(obj: Any) -> list[types.CodeType]:
    """Return the code of a function, or of the methods that a class defines itself."""
    if isinstance(obj, types.FunctionType):
        return [obj.__code__]
    result = []
    for member in vars(obj).values():
        inner = getattr(member, "__func__", getattr(member, "fget", member))
        inner = getattr(inner, "__wrapped__", inner)
        if isinstance(inner, types.FunctionType):
            result.append(inner.__code__)
    # What a decorator made (dataclass) has a made-up file name, which is looked at last.
    return sorted(result, key=lambda code: code.co_filename.startswith("<"))


def _recent_cells() -> list[str]:
    """Return the files of the cells, the newest first: for a class without a method of its own."""
    cells = [name for name in linecache.cache if "ipykernel" in name or "<ipython-input" in name]
    return cells[::-1]


def _cell(filename: str) -> _Cell | None:
    lines = [line.rstrip("\r\n") for line in linecache.getlines(filename)]
    try:
        tree = ast.parse("\n".join(lines) + "\n")
    except (SyntaxError, ValueError):
        return None
    return _Cell(filename, tree.body, lines) if lines else None


def _namespace(obj: Any) -> dict[str, Any]:
    if isinstance(obj, types.FunctionType):
        return obj.__globals__
    for member in vars(obj).values():
        inner = getattr(member, "__func__", getattr(member, "fget", member))
        if isinstance(inner, types.FunctionType) and inner.__module__ == obj.__module__:
            return inner.__globals__
    module = sys.modules.get(obj.__module__)
    return vars(module) if module is not None else {}


class _WithoutAnnotations(ast.NodeTransformer):
    """Annotations are never evaluated in a submission, so their names need not come along."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        self.generic_visit(node)
        return node

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        node.annotation = ast.Constant(value=None)
        self.generic_visit(node)
        return node


def _global_names(node: ast.stmt) -> set[str]:
    """Return the global names that a statement uses, in itself or in what it defines."""
    bare = _WithoutAnnotations().visit(ast.parse(ast.unparse(node)))
    top = symtable.symtable(ast.unparse(ast.fix_missing_locations(bare)), "<cell>", "exec")
    bound = {symbol.get_name() for symbol in top.get_symbols() if symbol.is_assigned()}
    used: set[str] = set()
    tables = [top]
    while tables:
        table = tables.pop()
        for symbol in table.get_symbols():
            free = table is top or symbol.is_global()
            if symbol.is_referenced() and free:
                used.add(symbol.get_name())
        tables += table.get_children()
    return {name for name in used - bound if not name.startswith("__")}


def _import_of(cell: _Cell, name: str) -> tuple[ast.Import | ast.ImportFrom, str] | None:
    """Return the cell's own import of a name, and what binds this name alone."""
    for node in cell.body:
        if isinstance(node, ast.Import):
            for alias in node.names:
                if (alias.asname or alias.name.partition(".")[0]) == name:
                    return node, ast.unparse(ast.Import([alias]))
        if isinstance(node, ast.ImportFrom) and node.module != "__future__":
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return node, ast.unparse(ast.ImportFrom(node.module, [alias], node.level))
    return None


def _is_own(line: str) -> bool:
    return line.split()[1].partition(".")[0] in _OWN


def _own_sentence(name: str, module: str, user: str) -> str:
    return (
        f"{user} uses {name} from {module}. The course's own code is not at hand while an answer "
        f"is graded: write what you need into the cell of {user}."
    )


def _assignment(cell: _Cell, name: str) -> ast.stmt | None:
    """Return the last plain assignment of a name in a cell."""
    result = None
    for node in cell.body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        targets = [node.target] if isinstance(node, ast.AnnAssign) and node.value else targets
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            result = node
    return result


def _literal(value: Any) -> str | None:
    """Return Python source of a plain number, text or tuple of such, or None for anything else."""
    if isinstance(value, float):  # NumPy's float64 is one
        value = float(value)
        text = repr(value) if math.isfinite(value) else f"float({str(value)!r})"
    elif type(value) in (int, bool, str, bytes, complex, type(None)):
        text = repr(value)
    elif type(value) is tuple:
        inside = [_literal(item) for item in value]
        if any(item is None for item in inside):
            return None
        text = f"({', '.join(map(str, inside))}{',' * (len(value) == 1)})"
    else:
        return None
    return text if len(text) <= _LONGEST else None


def _is_theirs(value: Any) -> bool:
    """Return whether a value under the name of a builtin was put there by the learner."""
    return getattr(_bare(value), "__module__", None) == "__main__" or _literal(value) is not None


def _importable(value: Any) -> tuple[str, str] | None:
    """Return the installed module that has a value, and its name there."""
    module, name = getattr(value, "__module__", None), getattr(value, "__name__", None)
    if not isinstance(module, str) or not isinstance(name, str):
        return None
    for place in (module, module.partition(".")[0]):
        result = sys.modules.get(place)
        if result is not None and place != "__main__" and getattr(result, name, None) is value:
            usable = _is_installed(result) or place.partition(".")[0] in _OWN
            return (place, name) if usable else None
    return None


def _is_installed(module: types.ModuleType) -> bool:
    """Return whether a module comes with Python or with a package.

    So that a submission can import it.
    """
    if module.__name__.partition(".")[0] in sys.stdlib_module_names:
        return True
    file = getattr(module, "__file__", None)
    if file is None:
        return module.__name__ in sys.builtin_module_names
    return "site-packages" in file or "dist-packages" in file
