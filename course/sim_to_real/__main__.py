"""`python -m course.sim_to_real` tunes the gains on record anew."""

from course.sim_to_real.tune import write_record

if __name__ == "__main__":
    write_record()
