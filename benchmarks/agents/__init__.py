"""Trained agents: what they reach on plants that no training has seen, and where they fall behind.

    python -m benchmarks.agents --stage all

The stages are `train`, `score` and `gap`; each goes on where it was interrupted, and `all` does one
after the other. A training lies in a folder of its own under --runs; the tables are made of the
policies that are there.
"""
