"""A part of the chart of learned planners, made again: one network, other worlds, the same band."""

import numpy as np

from course import charts
from course.charts.planning import learned as chart
from course.derivations.planning.learned import within
from course.planning import learned, scenes


def test_a_sampler_trained_anew_asks_as_little() -> None:
    net, rng = learned.train_sampler(seed=7), np.random.default_rng(70)
    for panel, turned in ((1, False), (2, True)):
        worlds = [learned.slits(rng, turned) for _ in range(80)]
        for success in chart.sampled([net], worlds, "uniform", "learned"):
            ratio = success.budget()[0] / within(panel, success.name, 0.5)
            assert 0.7 < ratio < 1.45, (success.name, turned)


def test_a_diffusion_trained_anew_collides_as_often() -> None:
    world = scenes.discs(count=chart.DISCS).world
    net = learned.train_diffusion(world, seed=7)
    requested = learned.questions(learned.grown(world), 60, np.random.default_rng(70))
    some = [scenes.Scene("discs", world, q.start, q.goal, 1.0) for q in requested]
    result = chart.proposed([net], some)
    assert 0.45 < result["diffusion, checked"][1][0] < 0.8
    assert result["diffusion, pushed out"][2][0] < 0.12
    solved = max(charts.stored("learned_planners")[3]["diffusion, checked"].y)
    assert abs(result["diffusion, checked"][0].ever - solved) < 0.12
