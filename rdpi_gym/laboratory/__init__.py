"""The laboratory: one local page on which a model is compared with measurements and grown."""
