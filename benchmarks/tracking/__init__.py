"""The tracking benchmark: controllers by references by plants, scored, ranked and drawn."""
