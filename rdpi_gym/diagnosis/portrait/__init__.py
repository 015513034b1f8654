"""The portrait of an effect that the catalogue does not have: where it sits and what it goes by."""
