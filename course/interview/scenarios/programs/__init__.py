"""The programs of the debugging scenarios, as the learner gets them: each has a planted fault."""
