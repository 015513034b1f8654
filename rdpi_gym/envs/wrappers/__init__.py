"""Wrappers and adapters around the environments."""
