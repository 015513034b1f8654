"""Linear loops: systems in samples, what a belief says of the path, certificates, bandwidths."""
