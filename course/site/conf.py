"""How Sphinx makes the pages; `course.site.build` writes what it reads, and calls it."""

from course.site.extension import linkcode_resolve as linkcode_resolve

project = html_title = "Robotics Simulation & Software"
author = ""
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.linkcode",
    "course.site.extension",
]
root_doc = "index"
language = "en"

highlight_language = "none"
nb_execution_mode = "off"
nb_render_markdown_format = "myst"
nb_ipywidgets_js: dict[str, dict[str, str]] = {}
nb_mime_priority_overrides = [("html", "text/markdown", 0), ("html", "text/html", 1)]
myst_enable_extensions = ["dollarmath"]
# The notebooks are written for a reader that knows none of these.
myst_disable_syntax = ["myst_block_break", "myst_line_comment", "myst_role", "myst_target"]
smartquotes = False
# The reference (modules.py): signatures with short types, attributes of a class as one list.
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_use_ivar = True
napoleon_attr_annotations = False  # the signature has them
napoleon_numpy_docstring = False
myst_update_mathjax = False
suppress_warnings = ["myst.header", "toc.not_included"]

html_theme = "furo"
# Pictures that are drawn on white: see course.css.
html_theme_options = {
    "light_css_variables": {"picture-filter": "none"},
    "dark_css_variables": {"picture-filter": "invert(0.93) hue-rotate(180deg)"},
}
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["course.css"]
# The box of chapter 1, in the page itself: a browser then asks for no file, from the disk neither.
html_favicon = (
    "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 16 16'%3E"
    "%3Cpath fill='%23f4b183' stroke='%23c55a11' d='M3 3 13 5 12 12 2 10z'/%3E%3C/svg%3E"
)
html_copy_source = html_show_sourcelink = html_show_search_summary = False
html_show_copyright = False
html_use_index = False
html_domain_indices = False
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"
