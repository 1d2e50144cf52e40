"""MuJoCo asked the questions of the course: a public kit, and one file a family of scenes."""
