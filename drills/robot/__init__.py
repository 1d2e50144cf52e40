"""Your robot: solved exercises become the parts of one pick-and-place machine.

A planar arm of two links works above a tilted table. A depth camera above it finds a part, which
may move; the arm picks it up and puts it into its slot, around posts that it must not touch.

- `records` says what goes into each of the six stages and comes out: typed records, SI units.
  A function of `records.Stages` can be replaced by your own without any exercise.
- `slots` is the table of slots. `stages` adapts each exercise's signature to its stage.
- `cell` is the world: tasks, posts, image, dynamics. The noise of task k depends on k alone, so
  that all robots meet the same tasks and the same noise (common random numbers).
- `loop` plays a task. The error of the placed part is split into the stages' shares, which add up.
- `parts` calls a part: timed, limited, and named where it fails. `promises` checks each part's own
  results by properties that any correct answer has.
- `inside` runs all of this in the sandbox's child process; `play` plays many tasks in two of them.
- `levels`, `faults`, `report`, `holders`, `store`, `film` and `history` are what a learner sees.
- `command` is `drills robot`, `running`, `hidden` and `pictures` its commands; `state` and `tables`
  are what they share. `unfinished` says how a killed run ended. `sweeps` plays a
  setting as a job of `course.measure.sweep`.

Left out on purpose: the gripper's orientation (a suction cup has none that matters), the arm in
the camera's image, the mass of the part, and contact between gripper and part.
"""
