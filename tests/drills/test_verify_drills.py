"""The interview drills proved on the real grader, as `drills verify` does it."""

from __future__ import annotations

import pytest

from drills import cards as catalogue
from drills import verify


@pytest.mark.parametrize("name", [card.name for card in catalogue.cards() if card.drill])
def test_drill_is_proved(name: str) -> None:
    findings = verify.findings_of(name, seeds=50)
    assert [f"{f.what}: {f.detail}" for f in findings if not f.passed] == []
    assert len(findings) >= 12
