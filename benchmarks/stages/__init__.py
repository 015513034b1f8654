"""The registered tasks as a benchmark: controllers by tasks by drawn plants, failures first."""
