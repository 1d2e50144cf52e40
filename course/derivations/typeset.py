"""Formulas in plain text, as the claims write them for a terminal, set as mathematics."""

import re

_GREEK = "alpha beta gamma delta zeta eta theta lambda mu nu pi rho sigma tau phi psi omega Omega"
_FUNCTIONS = "sqrt exp log sin cos tan asin acos atan asinh cosh det"
# As code writes them: alone in a sentence they stay what one types.
_SHORT = {"eps": r"\epsilon", "lam": r"\lambda"}
_NAMES = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}
_OPERATORS = {
    "+-": r"\pm",
    "<=": r"\le",
    ">=": r"\ge",
    "<": r"\lt",
    ">": r"\gt",
    "*": r"\,",
    ".": r"\cdot",
}
# The chapters whose step is not called h.
_STEP = {"control": "dt"}
_UNITS = set("msJNKW")
_TOKEN = re.compile(
    r"(?P<code>`[^`]*`|\b\d-[A-Z]\b)"  # code, or an arm such as 7-R
    rf"|(?P<greek>\b(?:{_GREEK.replace(' ', '|')})(?:_\w+)?\b)"
    rf"|(?P<function>\b(?:{_FUNCTIONS.replace(' ', '|')})(?=\())"
    r"|(?P<number>\b\d+(?:,\d{3})*(?:\.\d+)?(?:e[+-]?\d+)?(?!\w))"
    r"|(?P<symbol>\b(?:eps|lam|d[tqxv]\d?|[A-Za-z]\d?(?:_\w+)?'*)(?![\w-]))"
    r"|(?P<operator>\+-|<=|>=|[-+*/=<>^|]|(?<= )\.(?= ))"
    r"|(?P<open>\()|(?P<close>\))|(?P<space> +)|(?P<word>[^\s()`]+?(?=[\s()`,.;:]|$)|.)"
)
_WEAK = {"a", "A", "I", "s", *_SHORT}

Token = tuple[str, str]


def tex(text: str, topic: str = "") -> str:
    r"""Return a sentence with its formulas as mathematics: "omega h < 2" becomes $\omega h \lt 2$.

    A formula is a run of symbols (single letters, with a digit or an index), Greek names,
    functions, numbers and operators. A number with its unit, and the words "a" and "I", are none.

    Args:
        text: of a claim.
        topic: of its chapter; that of control calls the sample time dt, the others write h.
    """
    tokens = [(str(m.lastgroup), m.group()) for m in _TOKEN.finditer(text)]
    out, position = "", 0
    while position < len(tokens):
        end = _run(tokens, position)
        if end > position:
            out += f"${_set(tokens[position:end], _STEP.get(topic, 'h'))}$"
            position = end
        else:
            kind, word = tokens[position]
            out += word if kind == "code" else re.sub(r"([*_$<>])", r"\\\1", word)
            position += 1
    return out


def _run(tokens: list[Token], start: int) -> int:
    """Return the end of the formula that begins at `start`; `start` itself if there is none."""
    depth, end, position, before = 0, start, start, ""
    while position < len(tokens):
        kind, word = tokens[position]
        if kind == "open":
            depth += 1
        elif kind == "close":
            depth -= 1
        elif kind in ("word", "code") and not (depth and before == "function"):
            break
        if depth < 0:
            break
        position += 1
        if kind == "function":
            before = "function"
        complete = kind in ("greek", "symbol", "number", "close") or word == "|"
        if depth == 0 and complete:
            end, before = position, ""
    while end - start > 2 and tokens[end - 1][1] in _WEAK and tokens[end - 2][0] == "space":
        if tokens[end - 3][0] == "operator":
            break
        end -= 2  # the article, not a factor
    run = tokens[start:end]
    if start and tokens[start - 1][1] == "/":  # the rest of a unit
        return start
    if not run or run[0][0] in ("space", "close") or (run[0][1] in "*/=<>^|" and len(run) < 5):
        return start
    back = start
    while back and (tokens[back - 1][0] == "space" or tokens[back - 1][1] in _UNITS):
        back -= 1
    counted = 0 < back < start and tokens[back - 1][0] == "number"
    return end if _strong(run, counted) else start


def _strong(run: list[Token], unit: bool) -> bool:
    """Return whether a run is a formula, not a number with its unit or a word of one letter.

    Args:
        run: what may be one.
        unit: whether a number stands before it.
    """
    words = [(kind, word) for kind, word in run if kind != "space"]
    kinds = [kind for kind, _ in words]
    symbols = [word for kind, word in words if kind == "symbol"]
    if "greek" in kinds or "function" in kinds:
        return True
    if not symbols or (unit and set(symbols) <= _UNITS):
        return False
    # "3 N 768 times" is an amount and then a number, not a product.
    others = {word for kind, word in words[1:] if kind not in ("symbol", "number")}
    if kinds[0] == "number" and others <= {"/"} and set(symbols) <= _UNITS:
        return False
    if len(words) == 1:
        return symbols[0] not in _WEAK
    return words[0][1] not in _WEAK or words[1][0] == "operator"


def _set(run: list[Token], step: str) -> str:
    out, closing = "", [""]
    for position, (kind, word) in enumerate(run):
        if kind == "greek":
            name, _, index = word.partition("_")
            out += f"\\{name}" + (f"_{{{index}}}" if index else "") + " "
        elif kind == "function":
            out += f"\\{_NAMES.get(word, word)}"
        elif kind == "open":
            braces = out.endswith(("^", r"\sqrt"))
            out += "{" if braces else "("
            closing.append("}" if braces else ")")
        elif kind == "close":
            out += closing.pop()
        elif word == "x" and _crosses(run, position):
            out += r"\times"
        elif word == "dt":  # the step has one name in a chapter
            out += step
        elif word in _SHORT:
            out += f"{_SHORT[word]} "
        elif kind == "symbol" and word[-1].isdigit() and "_" not in word:
            out += f"{word[:-1]}_{word[-1]}"
        elif kind == "symbol" and "_" in word:
            name, _, index = word.rstrip("'").partition("_")
            primes = "'" * word.count("'")
            out += f"{name}_{{{index}}}{primes}"
        elif kind == "number" and out.endswith(("^", "^-")):
            out = out[: out.rindex("^") + 1] + f"{{{out[out.rindex('^') + 1 :]}{word}}}"
        elif kind == "operator":
            out += _OPERATORS.get(word, word) + (" " if word in _OPERATORS else "")
        elif kind == "word":
            out += rf"\text{{{word}}}"
        elif kind == "space":
            out = out.rstrip() + (r"\ " if run[position + 1][0] == "word" else " ")
        else:
            out += word
    return out.rstrip()


def _crosses(run: list[Token], position: int) -> bool:
    """Return whether an x between two symbols or before a bracket is a cross product."""
    after = [kind for kind, _ in run[position + 1 : position + 3]]
    kinds = [kind for kind, _ in run[max(position - 3, 0) : position + 4]]
    bracketed = kinds[:1] == ["open"] and kinds[-1:] == ["close"]
    pair = kinds[1:-1] if bracketed else kinds
    alone = len(pair) == 5 and (bracketed or len(run) == 5)
    alone = alone and all(kind in ("greek", "symbol") for kind in pair[::2])
    return bool(position) and after[:1] == ["space"] and (alone or after == ["space", "open"])
