"""Figures and the pages that they stand on: draws results that were computed elsewhere."""
