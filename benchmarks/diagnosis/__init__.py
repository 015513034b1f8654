"""Diagnosis as a benchmark: plants with known hidden effects, and diagnosers that say what is missing."""
