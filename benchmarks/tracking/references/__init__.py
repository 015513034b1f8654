"""References that controllers are scored on: a file states ``REFERENCES``, cases by name, and is found."""
