"""Which effect is missing: candidates refitted, ranked, added, and what is left."""
