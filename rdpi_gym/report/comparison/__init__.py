"""The page of a comparison of a model with measurements."""
