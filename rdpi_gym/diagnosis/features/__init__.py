"""Features of records: periods, rests, half-cycles, recurrence, noise floor."""
