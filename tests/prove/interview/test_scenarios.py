"""The model answer to a debugging scenario, for every cause and twenty seeds."""

from tests.interview.test_scenarios import EVERY, path_leaves_the_cause


@EVERY
def test_the_model_answer_leaves_the_cause_alone(name: str, cause: str) -> None:
    path_leaves_the_cause(name, cause, range(20))
