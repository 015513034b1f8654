"""From a program to files: source, vectors, the page, the FMU."""
