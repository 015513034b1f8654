"""A page and a picture for each effect of the catalogue, made from its file.

The picture shows the plant P10 with the effect on an experiment of the standard protocol, simulated
as `rdpi simulate` does, and what `rdpi fit` leaves of it: `python -m studies.effect_pages`.
"""
