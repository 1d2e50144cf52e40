"""Which code cells of a notebook are plumbing: they fetch, show or draw, and teach nothing.

A reader of a chapter sees the question, the picture and the card, not the call that makes them. The
build of the notebooks hides the code of such a cell in JupyterLab (`jupyter.source_hidden`) and
removes it from the site (the tag `remove-input`). The decision is made by the code itself:

- **hidden**: every statement is an import, a call of a display function (`DISPLAY`, or a helper of
  this notebook that only displays), or reads and prepares a stored text for one; or at least half
  of the cell's lines draw with Matplotlib;
- **typed into**: the cell calls `answer` or `checkpoint`, or says "change me". A learner
  edits it in JupyterLab, so it stays open there; on the site, where nothing can be run, it is
  removed;
- **shown**: everything else: algorithms, calls whose use is taught, exercises.

The tags `show-code` and `hide-code` of a cell in the source overrule the decision.
"""

import ast
from collections.abc import Iterable, Sequence
from typing import Any

from nbformat import NotebookNode

SHOWN, TYPED_INTO, HIDDEN = "shown", "typed into", "hidden"
SHOW_TAG, HIDE_TAG, SITE_TAG = "show-code", "hide-code", "remove-input"

# Functions that put something ready-made on the page.
DISPLAY = frozenset(
    {
        "HTML",
        "Markdown",
        "TradeOff",
        "badges",
        "card",
        "display",
        "figures",
        "home",
        "interview",
        "more_claims",
        "predict",
        "show",
        "simulation",
        "ticks",
        "your_robot",
    }
)
_TYPED = frozenset({"answer", "checkpoint"})
_TEXT = frozenset({"read", "replace", "join", "splitlines", "format"})  # prepare a shown text
_PICTURE = frozenset({"plt", "ax", "axes"})  # what a function that draws works on


def _name(call: ast.Call) -> str:
    """Return the last name of a call's function: `figures` of `cards.figures(...)`."""
    match call.func:
        case ast.Name(name):
            return name
        case ast.Attribute(attr=name):
            return name
    return ""


def _calls(node: ast.AST) -> list[str]:
    return [_name(inner) for inner in ast.walk(node) if isinstance(inner, ast.Call)]


def _parsed(source: str) -> list[ast.stmt]:
    """Return the statements of a cell; none where IPython's own syntax stands in it."""
    try:
        return ast.parse(source).body
    except SyntaxError:
        return []


def _names(node: ast.AST) -> set[str]:
    return {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}


def _drawing(body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """Return the statements that draw: they use pyplot, or what it returned in this cell."""
    drawn, result = {"plt"}, []
    for statement in body:
        if _names(statement) & drawn:
            result.append(statement)
            if isinstance(statement, ast.Assign):
                drawn |= {name for target in statement.targets for name in _names(target)}
                drawn.discard("_")
    return result


def helpers(sources: Iterable[str]) -> frozenset[str]:
    """Return the functions of a notebook that only display: they draw, print or return Markdown.

    Args:
        sources: of its code cells.
    """
    result, graded = set(), set()
    for statement in (one for source in sources for one in _parsed(source)):
        if isinstance(statement, ast.FunctionDef):
            if _names(statement) & _PICTURE or set(_calls(statement)) & (DISPLAY | {"print"}):
                result.add(statement.name)
        elif "check" in _calls(statement):
            graded |= _names(statement)
    return frozenset(result - graded)


def _is_text(value: ast.expr) -> bool:
    """Return whether a value is a stored text, or constants that name parts of one."""
    return "read" in _calls(value) or not any(
        isinstance(node, ast.Name | ast.Attribute | ast.Call) for node in ast.walk(value)
    )


def _only_shows(statement: ast.stmt, display: frozenset[str]) -> bool:
    match statement:
        case ast.Import() | ast.ImportFrom():
            return True
        case ast.Expr(ast.Constant(str())):
            return True
        case ast.Expr(ast.Call(func=ast.Name("print")) as call):
            return "read" in _calls(call) and set(_calls(call)) <= _TEXT | {"print"}
        case ast.Expr(ast.Call() as call):
            return _name(call) in display
        case ast.Assign(value=value):
            return set(_calls(value)) <= _TEXT | display and _is_text(value)
        case ast.FunctionDef(name=name):
            return name in display
    return False


def _lines(statements: Sequence[ast.stmt]) -> int:
    return sum((one.end_lineno or one.lineno) - one.lineno + 1 for one in statements)


def kind(source: str, tags: Sequence[str] = (), known: frozenset[str] = frozenset()) -> str:
    """Return what becomes of a code cell: `SHOWN`, `TYPED_INTO` or `HIDDEN`.

    Args:
        source: its code.
        tags: of the cell; `show-code` and `hide-code` decide.
        known: the notebook's own display functions, see `helpers`.

    Raises:
        ValueError: both tags are there.
    """
    if {SHOW_TAG, HIDE_TAG} <= set(tags):
        raise ValueError(f"tags must have {SHOW_TAG} or {HIDE_TAG}, got both")
    if SHOW_TAG in tags:
        return SHOWN
    if HIDE_TAG in tags:
        return HIDDEN
    body = _parsed(source)
    calls = {name for statement in body for name in _calls(statement)}
    if not body or "check" in calls:
        return SHOWN
    if calls & _TYPED or "change me" in source.lower():
        return TYPED_INTO
    display = DISPLAY | known
    teaches = any(isinstance(one, ast.Assign) for one in body) and not calls & (display | {"read"})
    if not teaches and all(_only_shows(statement, display) for statement in body):
        return HIDDEN
    drawing = _drawing(body)
    beside = [one for one in body if one not in drawing and _only_shows(one, display)]
    if drawing and 2 * _lines([*drawing, *beside]) >= _lines(body):
        return HIDDEN
    return SHOWN


def mark(cells: Sequence[NotebookNode]) -> None:
    """Mark the plumbing among the cells of a notebook, in place.

    A cell whose source is hidden by hand is plumbing, too.
    """
    code = [cell for cell in cells if cell.cell_type == "code"]
    known = helpers(cell.source for cell in code)
    for cell in code:
        metadata: dict[str, Any] = cell.metadata
        tags = list(metadata.get("tags", []))
        what = kind(cell.source, tags, known)
        if metadata.get("jupyter", {}).get("source_hidden") and SHOW_TAG not in tags:
            what = HIDDEN
        if what == SHOWN:
            continue
        if SITE_TAG not in tags:
            metadata["tags"] = [*tags, SITE_TAG]
        if what == HIDDEN:
            metadata["jupyter"] = {**metadata.get("jupyter", {}), "source_hidden": True}
