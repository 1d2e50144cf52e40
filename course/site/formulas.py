"""Formulas as MathML, made when the site is built: no script, nothing to fetch.

`latex2mathml` converts; what it only passes through, a command that it does not know, is refused.
"""

import functools
import html
import re
from xml.etree import ElementTree

from course.check import invalid

# Commands that the converter does not know, in those that it knows.
_ALSO = {r"\arg": r"\operatorname{arg}", r"\|": "\N{DOUBLE VERTICAL LINE}"}
_COMMAND = re.compile(r"\\(?:[A-Za-z]+|\|)")
# How many parts an element has; of a formula that breaks off the converter makes fewer.
_PARTS = {
    "mfrac": 2,
    "msub": 2,
    "msup": 2,
    "mover": 2,
    "munder": 2,
    "mroot": 2,
    "msubsup": 3,
    "munderover": 3,
}
# Names of functions: TeX sets a thin space between them and a letter or number beside them.
_NAME = (
    r"<mi>(?:arccos|arcsin|arctan|cos|cosh|cot|exp|ln|log|sin|sinh|tan|tanh)</mi>"
    r"|<msup><mi>(?:cos|sin|tan|log)</mi><m[in]>[^<]*</m[in]></msup>"
)
_BESIDE = re.compile(
    rf"(?P<before></mi>|</mn>|</msub>|</msup>|</mfrac>)(?=(?:{_NAME}))"
    # A name that has an exponent is spaced behind the exponent, never within.
    rf"|(?<!<msup>)(?<!<msub>)(?P<name>{_NAME})(?=<m(?:i|n|sub|sup|frac|over|sqrt)\b)"
)
_THIN = '<mspace width="0.167em"/>'
# What is no text: code, comments, tags. Then a formula of its own line, and one in a line.
_PART = re.compile(
    r"<(?P<quiet>code|pre|script|style|math)\b.*?</(?P=quiet)>|<!--.*?-->|</?[A-Za-z][^<>]*>"
    r"|(?<!\\)\$\$(?P<block>[^$]+)\$\$|(?<!\\)\$(?P<inline>[^$\n]*(?:\n[^$\n]+)*)\$",
    re.S,
)


@functools.cache  # a claim stands on its chapter's page and on that of all claims
def mathml(tex: str, block: bool = False) -> str:
    """Return a formula in LaTeX as a MathML element, which keeps the LaTeX as its text for readers.

    Args:
        tex: without dollars.
        block: whether it has a line of its own.

    Raises:
        ValueError: the formula does not convert, or only in parts.
    """
    from latex2mathml.converter import convert

    # Escaped braces are characters; the others have to match.
    bare = re.sub(r"\\.", "", tex)
    if bare.count("{") != bare.count("}"):
        raise invalid("formula", tex, "one with as many { as }")
    known = _COMMAND.sub(lambda match: _ALSO.get(match[0], match[0]), tex.strip())
    try:
        made = convert(known, display="block" if block else "inline")
    except Exception as problem:  # the converter has many, some of them IndexError
        raise invalid(
            "formula", tex, f"what latex2mathml reads ({type(problem).__name__})"
        ) from None
    # A frame is not part of what browsers draw of MathML; a border is.
    made = made.replace('<menclose notation="box">', '<mrow class="boxed">')
    made = made.replace("</menclose>", "</mrow>")
    made = _BESIDE.sub(lambda match: match[0] + _THIN, made)
    # Check the result too: the converter passes what it does not know into the text.
    for element in ElementTree.fromstring(made).iter():
        name, text = element.tag.rpartition("}")[2], element.text or ""
        if "\\" in text:
            raise invalid("formula", tex, f"LaTeX that latex2mathml knows, without {text}")
        if len(element) != _PARTS.get(name, len(element)):
            raise invalid("formula", tex, f"one that is whole (its {name} lacks a part)")
    # The LaTeX stays as alternative text, for screen readers and for copying.
    message = html.escape(" ".join(tex.split()))
    return made.replace("<math ", f'<math alttext="{message}" ', 1)


def in_html(text: str) -> str:
    """Return HTML with the formulas between dollars, outside of tags and code, as MathML.

    Raises:
        ValueError: a formula does not convert.
    """

    def converted(match: re.Match[str]) -> str:
        tex = match["block"] or match["inline"]
        # Cells' HTML has escaped < and &, which the converter must see as they are.
        return mathml(html.unescape(tex), bool(match["block"])) if tex else match[0]

    return _PART.sub(converted, text)
