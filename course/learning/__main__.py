"""`python -m course.learning` fits the policies on record anew."""

from course.learning.recorded import write_record

if __name__ == "__main__":
    write_record()
