"""Charts of chapter 5: motion planning."""
