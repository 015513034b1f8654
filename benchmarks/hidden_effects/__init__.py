"""The study of hidden effects: how often the laboratory names what is missing."""
