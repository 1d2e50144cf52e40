"""Wilson's interval of a success rate for the functions of a model, which are compiled."""

from numba.extending import register_jitable

from course.measure import success

score_interval = register_jitable(success.score_interval)
