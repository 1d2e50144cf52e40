"""What is known of an exercise without running anything: its card and its texts.

An exercise is a folder of `drills/catalogue`. `card.toml` says everything that a list, a prompt or
a hint needs, so that reading it imports nothing heavy; `prompt.md` is the task. The starter is the
head of the worked answer over the body `start` of the card, or `starter.py` where the learner
starts from more than one plain function. What the grader needs is in `drills.exercise`.
"""

from __future__ import annotations

import ast
import difflib
import functools
import textwrap
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CATALOGUE = Path(__file__).parent / "catalogue"
_LINE = 100  # columns


class UnknownExercise(ValueError):
    """No exercise has that name; `nearest` are the names that look like it."""

    def __init__(self, name: str, known: list[str]) -> None:
        self.name = name
        near = difflib.get_close_matches(name.lower(), known, n=3, cutoff=0.5)
        whole = [one for one in known if all(word in name.lower() for word in one.split("_"))]
        self.nearest = list(dict.fromkeys(whole + near))[:3]
        intended = f"; did you mean {' or '.join(self.nearest)}?" if self.nearest else ""
        super().__init__(f"no exercise is called {name!r}{intended}")


@dataclass(frozen=True)
class Quantity:
    """An argument or a result: its name, shape, unit and meaning, as the prompt states them."""

    name: str
    shape: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class Signature:
    """One callable that the learner writes: the function itself, a constructor or a method."""

    text: str
    arguments: tuple[Quantity, ...]
    returns: tuple[Quantity, ...]

    @property
    def name(self) -> str:
        """The name before the bracket."""
        return self.text.partition("(")[0]

    def counts(self) -> tuple[int, int]:
        """Return how many positional arguments are required, and how many may be given."""
        definition = ast.parse(f"def {self.text}: ...").body[0]
        assert isinstance(definition, ast.FunctionDef)
        total = len(definition.args.args)
        return total - len(definition.args.defaults), total


@dataclass(frozen=True)
class Hint:
    """One step of the ladder: what one sees, and what to look at."""

    symptom: str
    text: str


@dataclass(frozen=True)
class Card:
    """What is known of an exercise without running anything.

    Attributes:
        name: on the command line; the folder's name.
        title, chapter, difficulty, minutes, teaches: what the list shows; difficulty 1 to 5.
        entry: the name that a submission defines.
        kind: "function" or "class".
        signatures: what the learner writes, the entry first, then the methods of a class.
        solution: "module:name,name", where the worked answer stands.
        hints: three, each more telling than the one before.
        insight: the one thing to remember.
        drill: whether it is one of the interview drills; else an exercise of a chapter.
        place: in its chapter's notebook, from 1 on; 0 for a drill.
        start: body of the function that the learner starts from; empty where it is in starter.py.
        faulty: whether the learner starts from a whole program and has to find what is wrong in it.
    """

    name: str
    title: str
    chapter: int
    difficulty: int
    minutes: int
    teaches: str
    entry: str
    kind: str
    signatures: tuple[Signature, ...]
    solution: str
    hints: tuple[Hint, ...]
    insight: str
    drill: bool
    place: int = 0
    start: str = ""
    faulty: bool = False

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return CATALOGUE / self.name

    def starter(self) -> str:
        """Return the text that the learner starts from.

        With `start` on the card, signature and docstring are those of the worked answer.
        """
        if self.start:
            module = self.solution.partition(":")[0]
            return _starter_text(_module_file(module), self.entry, self.start)
        return (self.folder / "starter.py").read_text(encoding="utf-8")

    def cell(self) -> str:
        """Return the starter as a cell of a notebook: a docstring of one sentence, then `check`."""
        tree = ast.parse(self.starter())
        definition = next(n for n in tree.body if getattr(n, "name", "") == self.entry)
        assert isinstance(definition, ast.FunctionDef | ast.ClassDef)
        lines = self.starter().rstrip("\n").splitlines()
        head = definition.body[0]
        summary = (ast.get_docstring(definition) or "").partition("\n\n")[0]
        lines[head.lineno - 1 : head.end_lineno] = _indented(f'"""{summary}"""').splitlines()
        return "\n".join(lines[definition.lineno - 1 :]) + f"\n\n\ncheck({self.entry})\n"

    def prompt(self) -> str:
        """Return the task in Markdown: the text, then a table of arguments and results.

        A task that speaks of a faulty program first says where this program is.
        """
        parts = [f"# {self.title}"]
        if self.faulty:
            parts.append(
                f"`drills start {self.name}` writes the faulty program into your file; "
                "on a page of the course, it is in the cell below."
            )
        parts.append((self.folder / "prompt.md").read_text(encoding="utf-8").strip())
        for signature in self.signatures:
            rows = [("takes", q) for q in signature.arguments]
            rows += [("returns", q) for q in signature.returns]
            table = ["| | name | shape | unit | meaning |", "|---|---|---|---|---|"]
            table += [
                f"| {role} | `{q.name}` | {q.shape} | {q.unit} | {q.meaning} |" for role, q in rows
            ]
            parts.append(f"`{signature.text}`")
            if rows:
                parts.append("\n".join(table))
        return "\n\n".join(parts) + "\n"

    def solution_text(self) -> str:
        """Return the worked answer.

        The imports of its module that it uses, and the named definitions.
        """
        return _solution_text(self.solution)


def names() -> list[str]:
    """Return the names of all exercises, in the order of `cards`."""
    return [card.name for card in cards()]


@functools.cache
def cards() -> tuple[Card, ...]:
    """Return the cards of all exercises.

    By chapter, as its notebook has them, then drills, easy first.
    """
    result = map(_read_card, (path.parent for path in CATALOGUE.glob("*/card.toml")))
    return tuple(sorted(result, key=lambda c: (c.chapter, c.drill, c.place, c.difficulty, c.name)))


def card(name: str) -> Card:
    """Return the card of that name.

    Raises:
        UnknownExercise: with the nearest names.
    """
    for one in cards():
        if one.name == name:
            return one
    raise UnknownExercise(name, [c.name for c in cards()])


@functools.cache
def _solution_text(solution: str) -> str:
    module, _, names = solution.partition(":")
    return definitions(_module_file(module), names.split(","))


def definitions(path: Path, desired: list[str]) -> str:
    """Return the named definitions of a module, after the imports and names that they use.

    Args:
        path: a Python file.
        desired: names of functions, classes or assigned constants.

    Raises:
        ValueError: for a name that the file does not define.
    """
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    lines = text.splitlines()
    known = {name: node for node in tree.body for name in _defined(node)}
    missing = [name for name in desired if name not in known]
    if missing:
        raise ValueError(f"{path.name} does not define {', '.join(missing)}")
    selected: set[ast.stmt] = set()
    queue = [known[name] for name in desired]
    while queue:
        node = queue.pop()
        if node in selected:
            continue
        selected.add(node)
        used = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
        queue += [known[name] for name in used if name in known]
    future = "from __future__ import annotations"
    head = [future] if future in text else []
    imports = [n for n in tree.body if n in selected and isinstance(n, ast.Import | ast.ImportFrom)]
    if imports:
        head.append("\n".join(_text(node, lines) for node in imports))
    parts = ["\n\n".join(head)] if head else []
    for node in tree.body:
        if node in selected and not isinstance(node, ast.Import | ast.ImportFrom):
            parts.append(_text(node, lines))
    return "\n\n\n".join(parts) + "\n"


@functools.cache
def _starter_text(path: Path, name: str, body: str) -> str:
    """Return a function of a module with another body, as a learner starts from it.

    Types are left out, and of the docstring the explanation, which would give the method away:
    its first paragraph and the sections Args, Returns and Raises stay. Of the module's imports
    those stay that the body uses.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    function = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == name)
    used = {
        n.id for n in ast.walk(ast.parse(f"def f():\n{_indented(body)}")) if isinstance(n, ast.Name)
    }
    imports = [
        ast.unparse(node)
        for node in tree.body
        if isinstance(node, ast.Import | ast.ImportFrom) and used & set(_defined(node))
    ]
    for argument in ast.walk(function.args):
        if isinstance(argument, ast.arg):
            argument.annotation = None
    arguments = ast.unparse(function.args)
    signature = f"def {name}({arguments}):"
    if len(signature) > _LINE:
        signature = f"def {name}(\n    {arguments}\n):"
    paragraphs = (ast.get_docstring(function) or "").split("\n\n")
    sections = [p for p in paragraphs[1:] if p.startswith(("Args:", "Returns:", "Raises:"))]
    text = "\n\n".join([paragraphs[0], *sections])
    docstring = _indented(f'"""{text}\n"""' if sections else f'"""{text}"""')
    head = "\n".join(imports) + "\n\n\n" if imports else ""
    return f"{head}{signature}\n{docstring}\n{_indented(body).rstrip()}\n"


def _indented(text: str) -> str:
    return textwrap.indent(text, "    ")


def _defined(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.Import | ast.ImportFrom):
        return [(alias.asname or alias.name).partition(".")[0] for alias in node.names]
    if isinstance(node, ast.Assign):
        return [target.id for target in node.targets if isinstance(target, ast.Name)]
    if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
        return [node.target.id]
    return []


def _text(node: ast.stmt, lines: list[str]) -> str:
    first = node.lineno
    if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.decorator_list:
        first = node.decorator_list[0].lineno
    return "\n".join(lines[first - 1 : node.end_lineno])


def _module_file(module: str) -> Path:
    """Return the file of a module of this project, found without importing it."""
    path = Path(__file__).parents[1].joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _read_card(folder: Path) -> Card:
    with (folder / "card.toml").open("rb") as file:
        data: dict[str, Any] = tomllib.load(file)
    signatures = tuple(
        Signature(
            text=entry["text"],
            arguments=tuple(Quantity(*row) for row in entry.get("arguments", ())),
            returns=tuple(Quantity(*row) for row in entry.get("returns", ())),
        )
        for entry in data.pop("signatures")
    )
    hints = tuple(Hint(*row) for row in data.pop("hints"))
    return Card(name=folder.name, signatures=signatures, hints=hints, **data)
