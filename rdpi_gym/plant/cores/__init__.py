"""Hysteresis cores: what stands in the middle of the chain."""
