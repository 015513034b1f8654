"""What a command was doing: periods, rests, half cycles; the noise floor; what memory sees."""
