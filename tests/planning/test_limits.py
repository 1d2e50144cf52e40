"""The 7-R arm beside OMPL, states of its roadmaps, and how deep a clearance goes."""

import numpy as np
import pytest

from course import charts, contact
from course.oracles import ompl
from course.planning import capsule_arm, clearance, planar_arm, plane, shelf


def test_the_seven_joints_in_pure_python_say_what_the_compiled_ones_say() -> None:
    world, rng = shelf("tight").world, np.random.default_rng(4)
    slow, (fast, _) = ompl.plain(world), ompl.tests(world)
    states = rng.uniform(world.bounds[0], world.bounds[1], (120, 7))
    answers = [slow(q.tolist()) for q in states]
    assert answers == [fast(q) for q in states] and 20 < sum(answers) < 100


def test_the_seven_joints_are_thirty_times_faster_than_with_python_and_level_with_one_check() -> (
    None
):
    (panel,) = charts.stored("shelf_times")
    half = {s.label: np.asarray(s.x)[np.argmax(np.asarray(s.y) >= 0.5)] for s in panel.series}
    assert half["OMPL, Python states"] > 30.0 * half["ours"]
    assert 0.5 < half["OMPL, our edge check"] / half["ours"] < 2.0
    assert panel["ours"].y[-1] == panel["OMPL, our edge check"].y[-1] == 1.0
    assert panel["OMPL, Python states"].y[-1] < 1.0 == panel["OMPL, Python, 0.2%"].y[-1]


@pytest.mark.parametrize("level", [0.5, 0.8, 0.9])
def test_roadmaps_need_as_many_states_as_ompl_to_succeed_so_often(level) -> None:
    roadmaps = charts.stored("sample_counts")[-1].series
    for ours, other in zip(roadmaps[::2], roadmaps[1::2], strict=True):
        states = [np.interp(level, s.y, np.log(s.x)) for s in (ours, other)]
        assert abs(states[0] - states[1]) < np.log(1.35)


def test_a_clearance_is_no_deeper_than_the_link_that_goes_through() -> None:
    """Of a point in the plane it is the way out; of arms it is flat where a link passes a box."""
    block = [[1.0, -1.0, 3.0, 1.0]]
    assert clearance(plane([[0, -5], [5, 5]], boxes=block), [2.0, 0.0]) == pytest.approx(-1.0)
    arm = planar_arm([4.0], 0.05, boxes=block)
    assert [clearance(arm, [q]) for q in (-0.1, 0.0, 0.1)] == pytest.approx([-0.05] * 3)
    box = contact.box([0.3, 0.3, 0.3])
    for away in (0.0, 0.05, 0.1):  # around the first link, 0.07 thick
        arm = capsule_arm([(box, np.array([away, 0, 0.2, 1, 0, 0, 0]))])
        assert clearance(arm, np.zeros(7)) == pytest.approx(-0.08)
