"""The form of claims that is on its way out: it goes with the last file that is written in it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from course.derivations.answer import equivalent
from course.derivations.found import Found, Verdict


@dataclass(frozen=True)
class Finding:
    """What a check found."""

    figures: Mapping[str, Any]
    statement: str
    holds: bool
    corrected: bool
    holds_if: bool | None = None
    formula: Any = None


@dataclass(frozen=True)
class Adapted:
    """A check of the old form."""

    check: Callable[[], Finding]
    verdict: Verdict
    condition: str
    figures: Mapping[str, Any]

    def __call__(self, found: Found) -> None:
        finding = self.check()
        for name, value in finding.figures.items():
            text = isinstance(value, str)
            found.figures[name] = value if text else float(value)
            found.tolerances[name] = self.figures[name][1] if name in self.figures else 0.0
        found.statement, found.formula = finding.statement, finding.formula
        found.holds, found.facts = bool(finding.holds), [bool(finding.corrected)]
        if not finding.holds and finding.holds_if:
            found.condition, found.inside = self.condition or "?", [True]

    def record(self, claim: Any) -> dict[str, Any]:
        """The entry that the decorator holds."""
        figures = {
            name: [v if isinstance(v, str) else float(v), t]
            for name, (v, t) in self.figures.items()
        }
        return claim.entry(Found(claim.id)) | {
            "verdict": self.verdict.value, "condition": self.condition, "figures": figures
        }  # fmt: skip

    def faults(self, claim: Any, found: Found) -> list[str]:
        """What is wrong whatever is on record."""
        wrong = [] if found.facts[0] else ["the corrected statement does not hold"]
        if (claim.formula is None) != (found.formula is None):
            wrong.append("the record and the check must both have a formula, or neither")
        elif claim.formula is not None and not equivalent(claim.formula, found.formula):
            wrong.append(f"derived {found.formula}, on record is {claim.formula.expression}")
        return wrong


def adapted(claim_type: Any, file: str, told: tuple[Any, ...], old: dict[str, Any]) -> Any:
    """The claim of an old decorator's arguments (id, chapter, claim) and keywords."""
    id, chapter, heard = told

    def make(check: Callable[[], Finding]) -> Any:
        settled = Adapted(check, old["verdict"], old.get("condition", ""), old["figures"])
        return claim_type(
            id, file, chapter, heard, old["corrected"].replace("{", "{{").replace("}", "}}"),
            settled, old.get("formula"), old.get("source", ""),
        )  # fmt: skip

    return make
