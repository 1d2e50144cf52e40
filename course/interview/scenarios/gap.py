"""A roadmap finds no way through a door: causes, probes, repairs."""

from dataclasses import replace

import numpy as np

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs import gap as planner
from course.interview.scenarios.programs.gap import SIZE, Array, Mask, Room, clear, free

HALF, DOOR, WALL = 0.3, 1.1, 4.0  # half a carriage, width of the door, its place along x [m]
REACH = 4.0  # longest edge [m]
SHORT = 0.45  # of it, where it is too short [m]
TRIALS = 10  # roadmaps that are drawn for a symptom
NOWHERE = np.empty((0, 2))


def door_middle(seed: int) -> Array:
    """Return the middle of the door for a seed [m]."""
    return np.array([WALL, np.random.default_rng([8, seed]).uniform(1.8, 2.3)])


def ghosts(goal: Array) -> Array:
    """Return four thin boxes around the goal, (4, 4), which leave room for the carriage in it."""
    out, thick = 0.6, 0.05
    x, y = goal
    return np.array(
        [
            [x - out, y - out, x - out + thick, y + out],
            [x + out - thick, y - out, x + out, y + out],
            [x - out, y - out, x + out, y - out + thick],
            [x - out, y + out - thick, x + out, y + out],
        ]
    )


def room(cause: str, seed: int) -> Room:
    """Return the room of a seed that has a fault."""
    draw = np.random.default_rng([9, seed])
    middle = door_middle(seed)[1]
    half_door = 0.5 * (0.61 if cause == "improbable" else DOOR)
    goal = np.array([7.0, 3.05 if cause == "goal_inside" else 2.5]) + [draw.uniform(-0.3, 0.3), 0.0]
    start = draw.uniform(0.7, 1.1, 2)
    boxes = np.array(
        [
            [-0.1, -0.1, 0.0, 4.1],
            [8.0, -0.1, 8.1, 4.1],
            [-0.1, -0.1, 8.1, 0.0],
            [-0.1, 4.0, 8.1, 4.1],
            [3.95, -0.1, 4.05, middle - half_door],
            [3.95, middle + half_door, 4.05, 4.1],
            [1.4, 2.6, 2.2, 3.0],
            [5.6, 0.7, 6.2, 1.2],
            [6.3, 3.3, 7.7, 3.6],
        ]
    )
    if cause == "stale_map":
        boxes = np.vstack((boxes, [WALL - 0.1, middle - 0.2, WALL + 0.1, middle + 0.2]))
    if cause == "ghost_walls":
        boxes = np.vstack((boxes, ghosts(goal)))
    if cause == "start_inside":
        start[1] = 0.9 * HALF
    return Room(
        boxes=boxes,
        grown=HALF if cause == "inflated_twice" else 0.0,
        half=HALF,
        first=0.0,
        last=4.0 if cause == "edge_check" else 1.0,
        start=start,
        goal=goal,
        samples=60,
        reach=SHORT if cause == "short_edges" else REACH,
        hints=NOWHERE,
    )


def repaired(cause: str, seed: int, repair: str | None) -> Room:
    """Return the room after a repair."""
    one = room(cause, seed)
    if repair == "grow_once":
        return replace(one, grown=0.0)
    if repair == "guide":
        return replace(one, hints=door_middle(seed) + [[-0.6, 0.0], [0.0, 0.0], [0.6, 0.0]])
    if repair == "clip_edges":
        return replace(one, last=1.0)
    if repair == "stand_off":
        return replace(one, goal=np.minimum(one.goal, [np.inf, 2.9]))
    if repair == "clear_map":
        stale = np.all(np.abs(one.boxes[:, :2] - door_middle(seed)) < 0.25, axis=1)
        return replace(one, boxes=one.boxes[~stale])
    if repair == "drive_out":
        return replace(one, start=np.maximum(one.start, [0.0, 1.2 * HALF]))
    if repair == "filter_map":
        near = np.all(np.abs((one.boxes[:, :2] + one.boxes[:, 2:]) / 2.0 - one.goal) < 0.65, axis=1)
        thin = np.min(one.boxes[:, 2:] - one.boxes[:, :2], axis=1) < 0.06
        return replace(one, boxes=one.boxes[~(near & thin)])
    if repair == "longer_edges":
        return replace(one, reach=REACH)
    if repair == "more_samples":
        return replace(one, samples=3 * one.samples)
    return one


def failures(one: Room, seed: int, trials: int = TRIALS) -> float:
    """Return how many of the trials' roadmaps find no path."""
    draws = np.random.default_rng([10, seed]).spawn(trials)
    return float(sum(not planner.solved(one, draw) for draw in draws))


def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Return how many of ten roadmaps find no path."""
    return failures(repaired(cause, seed, repair), seed)


def price(cause: str, seed: int, repair: str) -> float:
    """Return pairs of points to look at, by those of the room as it came."""
    one, other = repaired(cause, seed, repair), room(cause, seed)
    return ((one.samples + len(one.hints)) / other.samples) ** 2


# --- Probes ---------------------------------------------------------------------------------------


def hand_path(one: Room, seed: int) -> Array:
    """Return a path through the middle of the door, (4, 2)."""
    before, after = door_middle(seed) + [[-0.8, 0.0], [0.8, 0.0]]
    return np.array([one.start, before, after, one.goal])


def goal_free(cause: str, seed: int) -> float:
    """Return whether the goal is free to the planner."""
    one = room(cause, seed)
    return float(free(one, one.goal[None])[0])


def path_edges(cause: str, seed: int) -> float:
    """Return how many of its three edges the planner's check of edges refuses."""
    one = room(cause, seed)
    path = hand_path(one, seed)
    return float(np.sum(~clear(one, path[:-1], path[1:])))


def margin(cause: str, seed: int) -> float:
    """Return the distance from a wall at which a point is refused [m]."""
    away = np.arange(0.005, 1.0, 0.01)
    points = np.column_stack((away, np.full(len(away), 2.0)))
    return float(away[np.argmax(free(room(cause, seed), points))])


def door_width(cause: str, seed: int) -> float:
    """Return free width of the door for the carriage's middle, to the planner [m]."""
    middle = door_middle(seed)
    across = np.arange(-1.0, 1.0, 0.002)
    points = middle + np.column_stack((0.0 * across, across))
    return 0.002 * float(np.sum(free(room(cause, seed), points)))


def cells(one: Room) -> tuple[Array, Mask]:
    """Return the areas [m^2] of a grid along the edges of all walls, and which cells are reachable.

    A cell is free or not as a whole, so that the flood is exact.
    """
    edges = np.clip(np.concatenate(planner.walls(one)), 0.0, SIZE)
    x, y = np.unique(edges[:, 0]), np.unique(edges[:, 1])
    area = np.outer(np.diff(x), np.diff(y))
    number = np.arange(area.size).reshape(area.shape)
    middles = np.meshgrid((x[1:] + x[:-1]) / 2.0, (y[1:] + y[:-1]) / 2.0, indexing="ij")
    open_ = free(one, np.column_stack([part.ravel() for part in middles]))
    pairs = np.concatenate(
        [np.column_stack((part[1:].ravel(), part[:-1].ravel())) for part in (number, number.T)]
    )
    first = number[np.searchsorted(x, one.start[0]) - 1, np.searchsorted(y, one.start[1]) - 1]
    result = planner.reached(area.size, pairs[open_[pairs].all(axis=1)], int(first))
    return area, result.reshape(area.shape)


def flood(cause: str, seed: int) -> float:
    """Return the area that the carriage's centre can reach from the start [m^2].

    The walls are those of the planner.
    """
    area, result = cells(room(cause, seed))
    return float(np.sum(area[result]))


def edges_against_points(cause: str, seed: int) -> float:
    """Return the share of random edges with free points that the planner rejects."""
    one, draw = room(cause, seed), np.random.default_rng([11, seed])
    a = draw.uniform(0.0, SIZE, (300, 2))
    b = a + draw.normal(0.0, 0.5, a.shape)
    share = np.linspace(0.0, 1.0, 41)[:, None, None]
    inner = (a + share * (b - a)).reshape(-1, 2)
    true = free(one, inner).reshape(41, -1).all(axis=0)
    return float(np.mean(~clear(one, a[true], b[true])))


def joined(cause: str, seed: int) -> float:
    """Return the share of a roadmap's points that the start is joined to, mean of six."""
    one, shares = room(cause, seed), []
    for draw in np.random.default_rng([12, seed]).spawn(6):
        points, pairs = planner.roadmap(one, draw)
        shares.append(np.mean(planner.reached(len(points), pairs)))
    return float(np.mean(shares))


def points_in_door(cause: str, seed: int) -> float:
    """Count how many of a hundred thousand uniform points lie in the door."""
    points = np.random.default_rng([13, seed]).uniform(0.0, SIZE, (10_000, 2))
    points = points[np.abs(points[:, 0] - WALL) < HALF]
    return 10.0 * float(np.sum(free(room(cause, seed), points)))


def wide_door(cause: str, seed: int) -> float:
    """Count how many of ten roadmaps find no path in a room without the wall."""
    one = room(cause, seed)
    return failures(replace(one, boxes=np.delete(one.boxes, [4, 5], axis=0)), seed)


def start_free(cause: str, seed: int) -> float:
    """Return whether the start is free to the planner."""
    one = room(cause, seed)
    return float(free(one, one.start[None])[0])


def triple(cause: str, seed: int) -> float:
    """Count how many of three roadmaps with three times the points find no path."""
    return failures(repaired(cause, seed, "more_samples"), seed, 3)


SCENARIO = Scenario(
    name="gap",
    title="No path through the door",
    prompt="A square carriage that cannot rotate has to get from one side of a wall to the "
    "other. The wall has a door, and the door is wider than the carriage. The planner "
    "builds ten random roadmaps (graphs of free points), and hardly any has a path. You can read "
    "the program, but not the dimensions of the room; you can only run the probes "
    "below. What is the cause, and what do you change?",
    symptom_words="number of ten roadmaps without a path",
    unit="",
    symptom=symptom,
    spread=0.2,
    removed=lambda figure: figure <= 2.0,
    causes=(
        Cause(
            "inflated_twice",
            "The map already enlarges every box by half the width of the carriage, and the "
            "collision checks enlarge it again. To the planner, the door is closed.",
            "grow_once",
        ),
        Cause(
            "improbable",
            "The door is open, but it is so little wider than the carriage that hardly any "
            "uniformly sampled point or edge passes through it.",
            "guide",
        ),
        Cause(
            "edge_check",
            "The edge check continues beyond the end of the edge, so it rejects edges because "
            "of a wall behind their end.",
            "clip_edges",
        ),
        Cause(
            "goal_inside",
            "The goal is closer to a shelf than half the width of the carriage, so it lies in "
            "the region that the carriage's centre must not enter.",
            "stand_off",
        ),
        Cause(
            "stale_map",
            "The map still contains a box in the door that was removed long ago.",
            "clear_map",
        ),
        Cause(
            "start_inside",
            "As the planner measures it, the carriage is closer to a wall than half its "
            "width, so the start lies in the region that its centre must not enter.",
            "drive_out",
        ),
        Cause(
            "ghost_walls",
            "Sensor reflections near the goal were entered in the map as walls around it.",
            "filter_map",
        ),
        Cause(
            "short_edges",
            "The longest edge that the roadmap tries is shorter than most distances between "
            "its points, so the roadmap falls apart into disconnected components.",
            "longer_edges",
        ),
    ),
    probes=(
        Probe(
            "ask_goal", "1 if the planner considers the goal free, 0 if not", "", 2, goal_free, 0.1
        ),
        Probe(
            "ask_start",
            "1 if the planner considers the start free, 0 if not",
            "",
            2,
            start_free,
            0.1,
        ),
        Probe(
            "hand_path_edges",
            "a path drawn by hand: how many of its three edges the edge check rejects",
            "",
            6,
            path_edges,
            0.3,
        ),
        Probe(
            "walk_to_wall",
            "distance from a wall below which the point check rejects a point",
            "m",
            4,
            margin,
            0.02,
        ),
        Probe(
            "measure_door",
            "width of the door that is free for the carriage's centre, according to the planner",
            "m",
            5,
            door_width,
            0.004,
        ),
        Probe(
            "flood",
            "area that the carriage's centre can reach from the start, according to the planner",
            "m^2",
            12,
            flood,
            0.5,
        ),
        Probe(
            "edges_by_points",
            "fraction of random edges that the edge check rejects although all their points pass "
            "the point check",
            "",
            8,
            edges_against_points,
            0.1,
        ),
        Probe(
            "joined_share",
            "fraction of a roadmap's points that are connected to the start",
            "",
            5,
            joined,
            0.12,
        ),
        Probe(
            "points_in_door",
            "number of 100,000 uniformly sampled points that fall in the door",
            "",
            4,
            points_in_door,
            200.0,
        ),
        Probe(
            "no_wall",
            "how many of ten roadmaps have no path when the wall is removed",
            "",
            3,
            wide_door,
            2.0,
        ),
        Probe(
            "triple_samples",
            "how many of three roadmaps have no path when each has three times the points",
            "",
            10,
            triple,
            2.0,
        ),
    ),
    repairs=(
        Repair(
            "grow_once",
            "The map stores the boxes at their real size; only the collision checks enlarge them.",
        ),
        Repair("guide", "Three points on the door's axis are added to the roadmap."),
        Repair("clip_edges", "Each edge is checked from its start to its end and no further."),
        Repair(
            "stand_off", "The goal is moved to the nearest free position in front of the shelf."
        ),
        Repair(
            "clear_map",
            "The map is recorded again, and objects that are no longer there are removed.",
        ),
        Repair("drive_out", "The carriage is driven away from the wall before planning starts."),
        Repair(
            "filter_map", "Thin boxes that only one sensor has detected are removed from the map."
        ),
        Repair("longer_edges", "The roadmap tries edges up to half the length of the room."),
        Repair("more_samples", "Each roadmap gets three times as many points."),
    ),
    popular="more_samples",
    price=price,
    price_words="number of point pairs to examine, relative to the original planner",
    affordable=2.0,
    path=7,
)
