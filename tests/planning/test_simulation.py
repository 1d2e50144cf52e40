"""Chapter 5's simulation: what grows is right, what is shown as a path is one, the notes hold."""

import math

import numpy as np
import pytest

from course.planning import check_path, length, plane
from course.planning.samplers import EDGE_CHECKS, SAMPLES
from course.planning.trees import NODES
from course.simulations import pen, simulation, splitmix
from course.simulations.model import Experiment
from course.simulations.pen import DISC, RED, decode
from course.simulations.planning import growing
from course.simulations.planning.growing import (
    BLOCKED,
    BUDGET,
    CONNECT,
    HIGH,
    LONG,
    MODEL,
    PIECES,
    PRM,
    RRT,
    SEARCHING,
    SOLVED,
    SPENT,
    STAR,
)
from tests.budget import sampled

METHODS = (RRT, CONNECT, STAR, PRM)
STEP, PLAN, SHORTCUT, RESET = (  # where one clicks
    (growing._CORNER[0] + pen.BUTTON * (k + 0.4), growing._CORNER[1] + 0.5 * pen.BUTTON_HIGH)
    for k in range(4)
)


def planned(preset, **values):
    """The question of a preset, with other values, to its end; RRT*, which goes on, for a while."""
    experiment = Experiment(MODEL)
    experiment.choose(preset)
    experiment.set(**values)
    if values.get("method") == STAR:
        experiment.advance(20.0)
    else:
        experiment.grab(*PLAN)
    return experiment


def world(experiment):
    boxes = [
        [x - w, y - h, x + w, y + h] for x, y, w, h in experiment.controls["pieces"] if w > 0.0
    ]
    return plane([[0.0, 0.0], [LONG, HIGH]], boxes=boxes)


def path(experiment):
    return experiment.state["path"][: experiment.state["corners"]].T


def right(experiment):
    """The judge's word on the path, from the start to the goal."""
    ends = experiment.controls["ends"]
    return check_path(world(experiment), path(experiment), ends[:2], ends[2:])


def at(x, y):
    """A place of the world [m] in units of the window."""
    remaining, end, low, top = growing._SCENE
    return remaining + x * (end - remaining) / LONG, low + y * (top - low) / HIGH


def test_a_simulation_begins_with_a_preset():
    panel = simulation("growing", "Bug trap")
    assert panel.controls["ends"].tolist() == [5.0, 2.6, 15.5, 4.5]
    panel.close()
    with pytest.raises(ValueError, match="preset"):
        simulation("growing", "a maze")


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("preset", sampled(list(MODEL.presets), 2))
def test_a_path_is_one_unless_edges_are_not_tested_exactly(preset, method):
    now = planned(preset, method=method)
    state = now.state
    if preset == "Unreachable goal":
        assert not state["corners"] and (state["became"] == SPENT or method == STAR)
    if preset == "Tunnelling edge check":
        shown = now.picture().numbers
        assert state["became"] == SOLVED and not right(now)
        edges = [check_path(world(now), path(now)[:, k : k + 2]) for k in range(path(now).shape[1])]
        assert int(shown["path edges in collision"]) == sum(not edge for edge in edges) > 0
        now.set(check=0)
        now.advance(10.0)
        assert now.state["became"] != SOLVED
    elif state["became"] == SOLVED:
        assert right(now)
        assert state["length"] == pytest.approx(length(path(now)), rel=1e-12)
        if method != PRM:
            step = float(now.controls["step"])
            assert np.linalg.norm(np.diff(path(now)), axis=0).max() <= step + 1e-12
        assert RED not in {i.style[0] for i in decode(now.picture()) if i.kind == pen.LINE}
    assert state["counts"][SAMPLES] <= BUDGET[method]


@pytest.mark.prove
@pytest.mark.parametrize("method", METHODS)
def test_a_plan_is_its_steps(method):
    """Sample by sample, second by second, or at once: the same numbers, so the same nodes."""
    whole, stepped, played = (Experiment(MODEL) for _ in range(3))
    for experiment in (whole, stepped, played):
        experiment.choose("Among obstacles")
        experiment.set(method=method, step=0.8)
    whole.grab(*PLAN)
    count = int(whole.state["counts"][SAMPLES]) if method != STAR else 60
    for _ in range(count):
        stepped.grab(*STEP)
    played.advance(count / 40.0)
    number = stepped.state["counts"][NODES]
    for other in (whole, played):
        np.testing.assert_array_equal(
            stepped.state["nodes"][0, :number], other.state["nodes"][0, :number]
        )
    assert stepped.state["counts"][SAMPLES] == played.state["counts"][SAMPLES] == count
    if method != STAR:
        assert stepped.state["counts"][EDGE_CHECKS] == whole.state["counts"][EDGE_CHECKS]
    stepped.grab(*RESET)
    assert stepped.state["counts"][SAMPLES] == 0 and stepped.state["became"] == SEARCHING


def test_shortcuts_shorten_and_stay_right():
    for seed in range(6):
        now = planned("Among obstacles", seed=seed)
        before = length(path(now))
        now.grab(*SHORTCUT)
        assert right(now)
        assert length(path(now)) < before == pytest.approx(float(now.state["length"]))
        straight = math.dist(now.controls["ends"][:2], now.controls["ends"][2:])
        assert length(path(now)) > straight


@pytest.mark.prove
def test_the_notes_of_the_presets_hold():
    """In the trap two trees need far fewer samples, and a goal bias makes it worse."""

    def samples(preset, **values):
        """Of five seeds the median; what is spent counts as more than any."""
        runs = [planned(preset, seed=seed, **values) for seed in range(5)]
        return float(
            np.median(
                [
                    r.state["counts"][SAMPLES] if r.state["became"] == SOLVED else math.inf
                    for r in runs
                ]
            )
        )

    trap = samples("Bug trap", method=RRT)
    assert samples("Bug trap", method=CONNECT) < 0.5 * trap
    assert trap < 0.5 * samples("Bug trap", method=RRT, bias=0.9)


def test_pieces_are_placed_moved_resized_and_taken_away():
    now = Experiment(MODEL)
    now.choose("Unreachable goal")
    now.grab(*at(3.0, 7.0))  # free ground: a new one, whose rim is in hand
    now.drag(*at(3.5, 7.8))
    np.testing.assert_allclose(now.controls["pieces"][4], [3.0, 7.0, 0.5, 0.8], atol=1e-9)
    assert now.controls["piece"] == 6 and now.state["count"] == 20
    now.grab(*at(3.1, 7.1))  # inside: it moves, and does not jump
    now.drag(*at(4.1, 6.1))
    np.testing.assert_allclose(now.controls["pieces"][4], [4.0, 6.0, 0.5, 0.8], atol=1e-9)
    now.grab(*at(4.5, 6.0))
    now.drag(*at(4.0, 6.0))
    assert now.controls["pieces"][4, 2] == 0.0 and now.state["count"] == 16
    now.grab(*at(1.5, 4.5))
    now.drag(*at(12.6, 4.5))  # the start into the wall
    assert now.state["became"] == BLOCKED
    now.grab(*PLAN)
    assert now.state["counts"][SAMPLES] == 0
    assert now.picture().numbers["status"] == "start or goal in collision"
    now.drag(*at(1.0, 1.0))  # a button is no handle
    assert now.state["became"] == BLOCKED
    for _ in range(PIECES + 3):  # no more than there is room for
        now.grab(*at(1.0, 8.0))
        now.drag(*at(1.4, 8.4))
    assert (now.controls["pieces"][:, 2] > 0.0).sum() <= PIECES


def test_the_keyboard_does_what_the_pointer_does():
    now = Experiment(MODEL)
    now.choose("Narrow gap")
    for key in ("ArrowRight", "ArrowUp", "ArrowUp", "ArrowLeft", "ArrowDown"):
        now.press(key)
    np.testing.assert_allclose(now.controls["ends"], [1.0, 2.1, 16.0, 7.0], atol=1e-12)
    now.press("+")
    assert now.state["counts"][SAMPLES] == 1
    now.set(piece="obstacle 1")
    now.press("-")
    np.testing.assert_allclose(now.controls["pieces"][0], [8.8, 2.9, 0.15, 2.8], atol=1e-12)
    assert now.state["counts"][SAMPLES] == 0
    now.set(piece="obstacle 5")
    now.press("+")  # one that is not there comes
    assert now.controls["pieces"][4, 2] > 0.0
    shown = [item for item in decode(now.picture()) if item.kind == DISC]
    assert len(shown) == 2  # start and goal


def test_a_stream_gives_the_numbers_of_its_seed():
    for law, one in ((splitmix.uniform, "random"), (splitmix.normal, "standard_normal")):
        seed, other, out = np.array([9], np.uint64), np.array([9], np.uint64), np.empty(1)
        stream = splitmix.Stream(seed)
        for _ in range(5):
            law(other, out)
            assert getattr(stream, one)() == out[0]
