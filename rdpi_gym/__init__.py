"""Piezo micro- and nano-positioning under hysteresis."""
