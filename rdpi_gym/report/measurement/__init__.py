"""Pictures and page of measured records, before any model."""
