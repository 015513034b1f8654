"""Picture and page of an identified model."""
