"""A kernel's own source as C: for one lane and one sample, with all that is known of it folded."""
