"""What Sphinx is taught: formulas as MathML, pictures that wait, the scripts of a page."""

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util import logging

from course.site.formulas import in_html, mathml
from course.site.notebooks import CHARTS, PICTURES

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


def _wide(app: Sphinx, _doctree: nodes.document) -> None:
    """Give the home page the whole width: it has no contents of its own beside it."""
    if app.env.docname == app.config.root_doc:
        app.env.metadata[app.env.docname]["hide-toc"] = ""


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the extension; Sphinx calls this."""
    app.add_config_value("course_simulations", {}, "html")
    app.add_html_math_renderer("mathml", (_visit_math, None), (_visit_math_block, None))
    app.add_post_transform(Page)
    app.connect("doctree-read", _wide)
    app.connect("html-page-context", _scripts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
