"""What a discovered belief is worth to a compensator, drawn."""
