"""The page of a diagnosis or a discovery."""
