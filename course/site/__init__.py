"""The static site: the course's notebooks as pages that need no kernel, `python -m course.site`.

`build` makes the folder; `pages` says what is on a page, `formulas` makes MathML, `conf` tells
Sphinx how the pages look.
"""
