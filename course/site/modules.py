"""The reference of the code: pages made from the docstrings of every public module, by autodoc.

`GROUPS` says which module is on which page. The docstrings are written for `help()`: names stand in
single backquotes and code is indented. `prepared` turns them into reStructuredText.
"""

import functools
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from course import CHAPTERS, Chapter


@dataclass(frozen=True)
class Group:
    """A page of the reference.

    Attributes:
        page: its name.
        title: its title.
        modules: import paths; of a package, its modules follow.
        chapter: the chapter whose code it is; None for what several chapters share.
    """

    page: str
    title: str
    modules: tuple[str, ...]
    chapter: Chapter | None = None


SHARED = (
    Group("code_vector_env", "Vector environments", ("course.vector_env",)),
    Group("code_measure", "Measuring speed against accuracy", ("course.measure",)),
    Group("code_oracles", "Adapters to other libraries", ("course.oracles",)),
    Group(
        "code_framework",
        "Simulations, charts and claims",
        (
            "course.simulations",
            "course.simulations.model",
            "course.simulations.record",
            "course.simulations.pen",
            "course.simulations.space",
            "course.simulations.splitmix",
            "course.simulations.declaration",
            "course.charts",
            "course.derivations",
        ),
    ),
    Group(
        "code_shared",
        "Validation, compiling, optional libraries",
        ("course.check", "course.compiled", "course.libraries"),
    ),
)
GROUPS = (
    *(
        Group(f"code_{c.topic}", f"Code of chapter {c.number}: {c.title}", (c.module,), c)
        for c in CHAPTERS
        if c.ready
    ),
    *SHARED,
)
# Packages that stand here without their modules, each of which is on another page or is no API.
ALONE = ("course.simulations", "course.charts", "course.derivations")
_NAME = re.compile(r"`([A-Za-z_][\w.]*)(\(\))?`")
_CODE = re.compile(r"`([^`\n]+)`")
# Several attributes described as one, which Napoleon would take for a type and a name.
_SEVERAL = re.compile(r"^\s+\w+(?:, \w+)+(?=:)")
_STARRED = re.compile(r"^\s+\*{1,2}\w+(?: \([^)]*\))?:")


@functools.cache
def of_group(group: Group) -> tuple[str, ...]:
    """Return the modules of a page: those of a package after the package, without private ones."""
    result = []
    for name in group.modules:
        result.append(name)
        if name not in ALONE:
            path = getattr(importlib.import_module(name), "__path__", ())
            for module_info in pkgutil.walk_packages(path, f"{name}."):
                if not any(part.startswith("_") for part in module_info.name.split(".")):
                    result.append(module_info.name)
    return tuple(result)


def first_line(thing: object) -> str:
    """Return the first paragraph of a docstring, on one line."""
    return " ".join((inspect.getdoc(thing) or "").partition("\n\n")[0].split())


def _is_package(module: str) -> bool:
    return hasattr(importlib.import_module(module), "__path__")


@functools.cache
def documented(module: str) -> Mapping[str, str]:
    """Return the public names of a module that the reference documents, each with its full name.

    Args:
        module: its import path. Its `__all__` names them; without one they are what it defines.
    """
    imported = importlib.import_module(module)
    result = {}
    for name in getattr(imported, "__all__", None) or vars(imported):
        if name.startswith("_"):
            continue
        thing = getattr(imported, name)
        home = getattr(thing, "__module__", None) or ""
        is_code = inspect.isclass(thing) or inspect.isroutine(thing)
        if is_code and home.startswith(module) and inspect.getdoc(thing):
            result[name] = f"{home}.{thing.__qualname__}"
    return result


def public(chapter: Chapter) -> Mapping[str, str]:
    """Return the public names of a chapter's module, each with its full name."""
    return documented(chapter.module)


@functools.cache
def addresses() -> Mapping[str, str]:
    """Return where each name that a text may use is documented: page#anchor.

    A name is written with its module: "rigid_body.simulate" or "course.rigid_body.simulate". A
    module is written with the package: "course.rigid_body".
    """
    result = {}
    for group in GROUPS:
        for module in of_group(group):
            result[module] = f"{group.page}.html#module-{module}"
            for name, full in documented(module).items():
                home = full.rpartition(".")[0]
                if home == module and module not in ALONE and _is_package(module):
                    continue  # the page documents the modules of a package, not its `__init__`
                for alias in (f"{module}.{name}", f"{module.removeprefix('course.')}.{name}", full):
                    result.setdefault(alias, f"{group.page}.html#{full}")
    return result


def address(text: str, module: str = "") -> str:
    """Return where the code in a text leads to; "" where it is no public name.

    Args:
        text: inline code, such as "simulate", "rigid_body.simulate" or "simulate()".
        module: import path of what the page is about, for names without a module.
    """
    name = text.removesuffix("()")
    if module and name in documented(module):
        name = f"{module}.{name}"
    return addresses().get(name, "")


def mentioned(text: str, chapter: Chapter) -> Iterator[tuple[int, str]]:
    """Yield where inline code of a Markdown text names something public of the chapter.

    (place in the text, name).
    """
    for code in _NAME.finditer(text):
        name = code[1].removeprefix("course.").removeprefix(f"{chapter.topic}.")
        if name in public(chapter):
            yield code.start(), name


def prepared(lines: Sequence[str]) -> list[str]:
    """Return a docstring as reStructuredText.

    Names in backquotes become references, other code literals. A paragraph that ends with a colon
    before an indented block introduces code. What would be markup elsewhere is escaped.

    Args:
        lines: of the docstring, in Google style.
    """
    result, block = [], None
    for number, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if block is not None and line.strip() and indent <= block:
            block = None
        after = next((text for text in lines[number + 1 :] if text.strip()), "")
        opens = (
            line.rstrip().endswith(":")
            and lines[number + 1 : number + 2] == [""]
            and len(after) - len(after.lstrip()) > indent
        )
        if block is not None or line.lstrip().startswith((">>>", "...")):
            result.append(line)
        else:
            result.append(_marked(line) + ":" * opens)
        if opens:
            block = indent
    return result


def _marked(line: str) -> str:
    """Return a line of prose with references and literals, everything else escaped."""
    star = _STARRED.match(line)
    head, line = (star[0], line[star.end() :]) if star else ("", line)
    line = _SEVERAL.sub(lambda names: names[0].replace(", ", ","), line)
    parts, end = [head], 0
    for code in _CODE.finditer(line):
        name = _NAME.fullmatch(code[0])
        marked = f":py:obj:`{code[1]}`" if name else f"``{code[1]}``"
        # Markup ends before a letter only where a backslash separates the two.
        separate = "\\ " if line[code.end() : code.end() + 1].isalnum() else ""
        parts += [_escaped(line[end : code.start()]), marked, separate]
        end = code.end()
    return "".join([*parts, _escaped(line[end:])])


def _escaped(text: str) -> str:
    """Return text in which nothing is markup: stars, bars, and underscores that end a word."""
    text = text.replace("\\", "\\\\")
    return re.sub(r"([*|`]|(?<=\w)_(?!\w))", r"\\\1", text)


def _heading(text: str, line: str) -> str:
    return f"{text}\n{line * len(text)}"


def _names(chapter: Chapter, anchors: Mapping[str, set[str]]) -> str:
    """Return the table of a chapter's public names: what each does, and where the text uses it."""
    page = f"{chapter.number:02d}_{chapter.topic}"
    module = importlib.import_module(chapter.module)
    rows = [
        ".. list-table::",
        "   :header-rows: 1",
        "",
        "   * - name",
        "     - what",
        "     - text",
    ]
    for name, full in public(chapter).items():
        anchor = f"code-{name}"
        where = f"`chapter <{page}.html#{anchor}>`__" if anchor in anchors.get(page, ()) else ""
        rows += [
            f"   * - :py:obj:`{name} <{full}>`",
            f"     - {_marked(first_line(getattr(module, name)))}",
            f"     - {where}".rstrip(),
        ]
    return "\n".join(rows)


def page(group: Group, anchors: Mapping[str, set[str]]) -> str:
    """Return a page of the reference, in reStructuredText.

    Args:
        group: which one.
        anchors: of the chapters' pages.
    """
    parts = [_heading(group.title, "=")]
    if group.chapter:
        number, topic = group.chapter.number, group.chapter.topic
        parts.append(f":doc:`Chapter {number} <{number:02d}_{topic}>` explains it.")
    for name in of_group(group):
        parts.append(_heading(name, "-"))
        members = (
            ""
            if _is_package(name) and name not in ALONE
            else "\n   :members:\n   :member-order: bysource"
        )
        parts.append(f".. automodule:: {name}{members}")
        if group.chapter and name == group.chapter.module and public(group.chapter):
            parts.append(_names(group.chapter, anchors))
    return "\n\n".join(parts) + "\n"


def index() -> str:
    """Return the first page of the reference: every page and what its modules are for."""
    parts = [
        _heading("Reference of the code", "="),
        "Every public module, from its docstrings. Arrays have their components along the first "
        "axis, units are SI, and wrong input raises ``ValueError``.",
    ]
    for group in GROUPS:
        parts.append(_heading(group.title, "-"))
        rows = []
        for name in of_group(group):
            words = _marked(first_line(importlib.import_module(name)))
            rows.append(f"* :py:mod:`{name}`: {words}")
        parts.append("\n".join(rows))
    pages = "\n   ".join(group.page for group in GROUPS)
    parts.append(f".. toctree::\n   :hidden:\n\n   {pages}")
    return "\n\n".join(parts) + "\n"
