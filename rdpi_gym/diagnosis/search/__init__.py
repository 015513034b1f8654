"""Search for missing effects: candidates refitted, ranked and added, and the residual judged."""
