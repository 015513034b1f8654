"""Benchmarks: tracking, tasks, the paper, discovery of effects, and their tables."""
