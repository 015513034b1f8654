"""Our stage: an effect and a controller that rdpi-gym finds by entry points."""
