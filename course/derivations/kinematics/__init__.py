"""Claims of chapter 4: where an arm is, how it moves, and what its joints feel."""
