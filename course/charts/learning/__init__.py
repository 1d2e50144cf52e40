"""The charts of chapter 9: robot learning."""
