r"""Formulas for a terminal: $\omega h < 2$ becomes ω h < 2, $\sqrt{k/m}$ becomes √(k/m)."""

from __future__ import annotations

import functools
import re

# The texts of the course use few commands. What is not here keeps its name without the backslash.
_GREEK = dict(
    zip(
        "alpha beta gamma delta epsilon varepsilon zeta eta theta kappa lambda mu nu xi pi rho "
        "sigma tau phi varphi chi psi omega Gamma Delta Theta Lambda Pi Sigma Phi Psi Omega"
        "".split(),
        "αβγδεεζηθκλμνξπρστφφχψωΓΔΘΛΠΣΦΨΩ",
        strict=True,
    )
)
_SIGNS = {
    **_GREEK,
    # Relations stand between spaces, as they do on a page.
    **{"le": " ≤ ", "leq": " ≤ ", "ge": " ≥ ", "geq": " ≥ ", "ne": " ≠ ", "neq": " ≠ "},
    **{"approx": " ≈ ", "lt": " < ", "gt": " > ", "ll": " ≪ ", "gg": " ≫ ", "propto": " ∝ "},
    **{"sim": " ~ ", "equiv": " ≡ ", "to": " → ", "rightarrow": " → ", "leftarrow": " ← "},
    **{"perp": " ⊥ ", "in": " ∈ ", "pm": "±", "mp": "∓", "cdot": " · ", "times": " × "},
    **{"infty": "∞", "sum": "Σ ", "prod": "Π ", "int": "∫", "partial": "∂"},
    **{"nabla": "∇", "circ": "°", "ldots": "...", "dots": "..."},
    **{"lceil": "⌈", "rceil": "⌉", "lfloor": "⌊", "rfloor": "⌋", "top": "T", "dagger": "+"},
    **dict.fromkeys(("lVert", "rVert", "|", "lvert", "rvert"), "|"),
    **dict.fromkeys((",", ";", ":", " ", "quad", "qquad"), " "),
    **dict.fromkeys(("!", "left", "right", "big", "Big", "displaystyle", "limits"), ""),
}
_FONTS = ("mathsf", "mathrm", "mathbf", "mathit", "mathcal", "operatorname", "text", "boldsymbol")
_ACCENTS = {"dot": "'", "ddot": "''", "hat": "^", "tilde": "~", "bar": "-", "vec": ""}
_POWERS: dict[str, str] = dict(zip("0123456789+-n", "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁿ", strict=True))

_CODE = re.compile(r"(```.*?```|`[^`\n]*`)", re.S)
_MATH = re.compile(r"\$\$?([^$]+?)\$\$?", re.S)
_CODE_OR_MATH = re.compile(r"(`[^`\n]*`|\$[^$]+\$)", re.S)
_GROUP = r"(?:\{([^{}]*)\}|(\\[A-Za-z]+|\w))"  # an argument: a group without groups, or one sign
_STEPS = [
    (re.compile(r"\\[td]?frac\s*" + _GROUP + r"\s*" + _GROUP), "fraction"),
    (re.compile(r"\\sqrt\s*" + _GROUP), "root"),
    (re.compile(r"\\(" + "|".join(_FONTS) + r")\s*" + _GROUP), "font"),
    (re.compile(r"\\(" + "|".join(_ACCENTS) + r")(?![A-Za-z])\s*" + _GROUP), "accent"),
    (re.compile(r"([_^])\s*\{([^{}]*)\}"), "index"),
]


def readable(markdown: str) -> str:
    """Return Markdown whose formulas between dollars are plain text; code stays as it is."""
    pieces = _CODE.split(markdown)
    pieces[::2] = [_MATH.sub(lambda m: _escaped(formula(m[1])), piece) for piece in pieces[::2]]
    return "".join(pieces)


def plain(markdown: str) -> str:
    """Return a line of Markdown with its formulas as plain text, for output that is not set."""
    return _MATH.sub(lambda m: formula(m[1]), markdown)


def literal(sentence: str) -> str:
    """Return a sentence as Markdown that shows its signs, as the products in 2*a*b.

    Code in backquotes and formulas between dollars stay what they are.
    """
    pieces = _CODE_OR_MATH.split(sentence)
    pieces[::2] = map(_escaped, pieces[::2])
    return "".join(pieces)


def formula(tex: str) -> str:
    """Return a formula of TeX as one line of text."""
    text = " ".join(tex.split())
    # The innermost groups first, until no command with a group is left.
    for _ in range(20):
        before = text
        for pattern, kind in _STEPS:
            text = pattern.sub(functools.partial(_replaced, kind), text)
        if text == before:
            break
    text = re.sub(r"\\([A-Za-z]+|.)", lambda m: _SIGNS.get(m[1], f" {m[1]}"), text)
    text = text.replace("{", "").replace("}", "")
    text = re.sub(r"\^(-?[0-9]+|[+n](?![A-Za-z]))", lambda m: "".join(map(_power, m[1])), text)
    text = re.sub(r"\^([+T])(?=[A-Za-z])", lambda m: f"^{m[1]} ", text)
    text = re.sub(r"([_^]) +", r"\1", text)
    text = re.sub(r"\| (\S+?) ?\|", r"|\1|", text)
    return re.sub(r"(?<=[(\[]) | (?=[)\],])", "", " ".join(text.split()))


def _power(sign: str) -> str:
    return _POWERS[sign]


def _replaced(kind: str, match: re.Match[str]) -> str:
    if kind == "fraction":
        above, below = match[1] or match[2], match[3] or match[4]
        return f"{_in_brackets(above)}/{_in_brackets(below)}"
    if kind == "root":
        return f"√{_in_brackets(match[1] or match[2])}"
    if kind == "font":
        return match[2] if match[2] is not None else match[3]
    if kind == "accent":
        inside = match[2] if match[2] is not None else match[3]
        sign = _ACCENTS[match[1]]
        return f" {inside}{sign} " if sign.startswith("'") else f"{inside}{'_hat' * (sign == '^')}"
    inside = match[2].strip()
    if match[1] == "^":
        return (
            f"^{inside}" if re.fullmatch(r"-?\w|\\[A-Za-z]+|[+*]|-?\d+", inside) else f"^({inside})"
        )
    return f"_{inside}" if re.fullmatch(r"[\w\\, +-]+", inside) else f"_({inside})"


def _in_brackets(text: str) -> str:
    """Return a text in brackets, unless it is one sign or one number."""
    return text if re.fullmatch(r"\w+|\\[A-Za-z]+", text) else f"({text})"


def _escaped(text: str) -> str:
    """Return a text in which Markdown finds nothing to set."""
    return re.sub(r"([\\*_<>`|\[\]])", r"\\\1", text)
