"""What Sphinx is taught: formulas as MathML, pictures that wait, the scripts of a page."""

import ast
import functools
import inspect
import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final
from weakref import WeakKeyDictionary

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode.parser import Parser
from sphinx.search import languages
from sphinx.search.en import SearchEnglish
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util import logging
from sphinx.util.typing import stringify_annotation

from course import CHAPTERS
from course.site import modules
from course.site.formulas import in_html, mathml
from course.site.notebooks import CHARTS, PICTURES, ROOT, TEXTS

_MODES: Final = ("smart", "fully-qualified-except-typing")
_ARRAY = re.compile(
    r"~?numpy\.ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], ~?numpy\.dtype\[~?(?:\w+\.)*(\w+)\]\]"
)
# What the pages of the three doors are about: the module of a name that stands there alone.
ABOUT = dict.fromkeys(TEXTS, "") | {
    "environments": "course.vector_env",
    "modules": "course.kinematics",
    "robot_planner": "course.planning",
    "your_method": "course.measure.work_precision",
}
_TABLE = re.compile(r"<table\b")
_CHART = re.compile(rf"{CHARTS}/(\w+)\.png")
_NARROW = (
    '<picture><source media="(max-width: 640px)" srcset="_static/charts/{}.svg" '
    'type="image/svg+xml">'
)
_FILM = re.compile(rf"{PICTURES}/film\.png")
_STILL = (
    f'<picture class="course-film"><source media="(prefers-reduced-motion: reduce)" '
    f'srcset="{PICTURES}/film.still.png" type="image/png">'
)
_LOG = logging.getLogger(__name__)


class _English(SearchEnglish):
    """The language of the search, which remembers the stem of a word: pages have the same words."""

    def __init__(self, options: dict[str, str]) -> None:
        super().__init__(options)
        self._stem = functools.cache(super().stem)

    def stem(self, word: str) -> str:
        """Return the stem of a word."""
        return self._stem(word)


def _formula(page: str, tex: str, block: bool) -> str:
    """Return a formula as MathML; one that does not convert is a fault of its page."""
    try:
        return mathml(tex, block)
    except ValueError as problem:
        _LOG.warning(f"{page}: {problem}")
        return ""


def _raw(text: str) -> nodes.raw:
    return nodes.raw("", text, format="html")


def _visit_math(self: Any, node: nodes.math) -> None:
    self.body.append(_formula(self.builder.current_docname, node.astext(), False))
    raise nodes.SkipNode


def _visit_math_block(self: Any, node: nodes.math_block) -> None:
    formula = _formula(self.builder.current_docname, node.astext(), True)
    self.body.append(f'<div class="course-formula">{formula}</div>\n')
    raise nodes.SkipNode


class Page(SphinxPostTransform):
    """Formulas in what is HTML already; pictures with a name, loaded when they come into sight."""

    default_priority = 900  # after the output of each cell has been chosen
    formats = ("html",)

    def run(self, **_options: Any) -> None:
        """Repair raw HTML, make tables scroll, and complete the attributes of images."""
        for raw in self.document.findall(nodes.raw):
            try:
                text = in_html(raw.astext())
            except ValueError as problem:
                _LOG.warning(f"{self.env.docname}: {problem}")
            else:
                # Wide tables scroll by themselves, so that the page does not on a phone.
                text = _TABLE.sub(r'<div class="table-wrapper">\g<0>', text)
                raw.children[:] = [nodes.Text(text.replace("</table>", "</table></div>"))]
        for example in self.document.findall(nodes.doctest_block):
            example["language"] = "pycon"
        self._link_code()
        for image in list(self.document.findall(nodes.image)):
            image["loading"] = "lazy"
            if _FILM.fullmatch(image["uri"]):
                del image["loading"]  # it is the first thing on the home page
                image.parent.insert(image.parent.index(image), _raw(_STILL))
                image.parent.insert(image.parent.index(image) + 1, _raw("</picture>"))
            if chart := _CHART.fullmatch(image["uri"]):
                # On a phone the narrow one, which `course.site.charts` draws.
                image.parent.insert(image.parent.index(image), _raw(_NARROW.format(chart[1])))
                image.parent.insert(image.parent.index(image) + 1, _raw("</picture>"))
            # An image without a description gets the title of its section.
            if not image.get("alt"):
                section = image.parent
                while section and not isinstance(section, nodes.section):
                    section = section.parent
                title = section.next_node(nodes.title) if section else None
                image["alt"] = f"Figure: {title.astext()}" if title else "Figure"

    def _link_code(self) -> None:
        """Let inline code lead to the reference, where it names something public.

        Chapters and the pages of the three doors have such links; the reference has its own.
        """
        about = {Path(c.notebook).stem: c.module for c in CHAPTERS} | ABOUT
        if self.env.docname not in about:
            return
        for literal in list(self.document.findall(nodes.literal)):
            linked = isinstance(literal.parent, nodes.reference)
            target = "" if linked else modules.address(literal.astext(), about[self.env.docname])
            if target:
                link = nodes.reference("", "", refuri=target, internal=True)
                literal.replace_self(link)
                link += literal


def _scripts(
    app: Sphinx, page: str, _template: str, _context: dict[str, Any], _doctree: nodes.document
) -> None:
    """Add the simulations of a page, what runs them, and what every page does."""
    app.add_js_file("page.js", loading_method="defer", priority=910)
    # The description of each simulation first; what runs them has a higher priority number and
    # comes after.
    for name in dict.fromkeys(app.config.course_simulations.get(page, ())):
        app.add_js_file(f"simulations/{name}.js", loading_method="defer")
    if app.config.course_simulations.get(page):
        app.add_js_file("live.js", loading_method="defer", priority=900)


# Of the environment of each build: a later one may have other titles.
_TITLES: WeakKeyDictionary[BuildEnvironment, dict[str, nodes.bullet_list]] = WeakKeyDictionary()


def _titles(app: Sphinx) -> dict[str, nodes.bullet_list]:
    """Return the table of contents of each document with its titles only, made once a build.

    The side bar of each page copies the contents of all pages, and then drops all but the titles.
    Contents that were cut to these before make the same side bar in a tenth of the time.
    """
    stored: dict[str, nodes.bullet_list] | None = _TITLES.get(app.env)
    if stored is None:
        stored = {}
        for name, contents in app.env.tocs.items():
            cut = contents.deepcopy()
            for top in cut.children:
                if isinstance(top, nodes.Element) and len(top) > 1:
                    # A page may list others; where it does, they stay in the side bar.
                    inner = list(top.findall(addnodes.toctree))
                    if inner:
                        top[1][:] = inner
                    else:
                        top.pop(1)
            stored[name] = cut
        _TITLES[app.env] = stored
    return stored


def _side_bar(
    app: Sphinx, _page: str, _template: str, context: dict[str, Any], _doctree: nodes.document
) -> None:
    """Let the theme make the side bar from titles alone."""
    made = context.get("toctree")
    if made is None:
        return

    def from_titles(**options: Any) -> str:
        whole = app.env.tocs
        app.env.tocs = _titles(app) if options.get("titles_only") else whole
        try:
            return str(made(**options))
        finally:
            app.env.tocs = whole

    context["toctree"] = from_titles


def linkcode_resolve(_domain: str, info: dict[str, str]) -> str | None:
    """Return where the source of an object is: in the repository that pyproject.toml names."""
    thing: Any = sys.modules.get(info["module"])
    try:
        for part in info["fullname"].split("."):
            thing = inspect.unwrap(getattr(thing, part))
        thing = getattr(thing, "py_func", thing)  # of what Numba compiled
        file = inspect.getsourcefile(thing)
        if file is None or not Path(file).is_relative_to(ROOT):
            return None
        # A function knows its first line; that of a class is looked up in its file.
        code = getattr(thing, "__code__", None)
        line = code.co_firstlineno if code else _classes(file)[thing.__qualname__]
    except (AttributeError, TypeError, KeyError):  # data have no source of their own
        return None
    return f"{_repository()}/blob/main/{Path(file).relative_to(ROOT).as_posix()}#L{line}"


@functools.cache
def _classes(file: str) -> dict[str, int]:
    """Return the first line of each class in a file, by its qualified name.

    `inspect.getsourcelines` would parse the whole file again for every class.
    """
    result: dict[str, int] = {}

    def note(body: Sequence[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.ClassDef):
                first = node.decorator_list[0] if node.decorator_list else node
                result.setdefault(prefix + node.name, first.lineno)
                note(node.body, f"{prefix}{node.name}.")

    note(ast.parse(Path(file).read_text(encoding="utf-8")).body, "")
    return result


@functools.cache
def _repository() -> str:
    """Return the address of the repository, which a fork sets in one place."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return str(settings["project"]["urls"]["Repository"]).rstrip("/")


def _docstring(
    _app: Sphinx, _what: str, _name: str, _thing: Any, _options: Any, lines: Any
) -> None:
    """Turn a docstring into reStructuredText before Napoleon reads its sections."""
    lines[:] = modules.prepared(lines)


@functools.cache
def _array_like() -> tuple[str, ...]:
    """Return NumPy's ArrayLike as Sphinx spells it out."""
    from numpy.typing import ArrayLike

    return tuple(stringify_annotation(ArrayLike, mode) for mode in _MODES)


def _signature(
    _app: Sphinx, _what: str, _name: str, _thing: Any, _options: Any, given: Any, returned: Any
) -> tuple[str | None, str | None]:
    """Write the types of a signature as the source does: ArrayLike, NDArray[float64]."""

    def named(text: str | None) -> str | None:
        for long in _array_like():
            text = text and text.replace(long, "ArrayLike")
        return text and _ARRAY.sub(r"NDArray[\1]", text)

    return named(given), named(returned)


def _skip(
    _app: Sphinx, _what: str, _name: str, thing: Any, skip: bool, _options: Any
) -> bool | None:
    """Leave out the fields of a NamedTuple, which its docstring explains as attributes."""
    return True if (inspect.getdoc(thing) or "").startswith("Alias for field number") else None


def _read(app: Sphinx, doctree: nodes.document) -> None:
    """Let names mean what they mean where they stand; give the home page the whole width.

    Sphinx would let the name of an attribute lead to any class that has one of that name.
    """
    for name in doctree.findall(addnodes.pending_xref):
        if name.get("refdomain") == "py":
            name.attributes.pop("refspecific", None)
    if app.env.docname == app.config.root_doc:
        app.env.metadata[app.env.docname]["hide-toc"] = ""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension; Sphinx calls this."""
    app.add_config_value("course_simulations", {}, "html")
    app.add_html_math_renderer("mathml", (_visit_math, None), (_visit_math_block, None))
    app.add_post_transform(Page)
    languages["en"] = _English
    # Where a definition begins and ends is for `viewcode`, which the site does not have; to find
    # that out takes longer than all else that autodoc reads in a module.
    Parser.parse_definition = lambda self: None
    app.connect("autodoc-process-docstring", _docstring, priority=400)
    app.connect("autodoc-process-signature", _signature)
    app.connect("autodoc-skip-member", _skip)
    app.connect("doctree-read", _read)
    app.connect("html-page-context", _scripts)
    app.connect("html-page-context", _side_bar, priority=400)  # before the theme's, at 500
    return {"parallel_read_safe": True, "parallel_write_safe": True}
