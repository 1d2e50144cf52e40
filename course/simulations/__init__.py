"""Interactive simulations: pure models of what happens, and the one canvas that shows them all."""
