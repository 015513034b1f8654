"""Discovery of hidden effects, counted on plants whose truth is known."""
