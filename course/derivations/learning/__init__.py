"""Claims of chapter 9, robot learning."""
