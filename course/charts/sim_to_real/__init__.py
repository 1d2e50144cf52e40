"""The charts of chapter 8: from simulation to the real robot."""
