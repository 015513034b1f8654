"""The pages that walk through the laboratory, made by running the commands that they show.

A template beside this file holds prose, commands and the names of pictures. `python -m
studies.tutorial` runs the commands in an empty folder, puts what they print below them, takes
the pictures from the pages that they write (in Chromium), fills the numbers of the prose in, and
refuses where a result contradicts a claim of the prose. Nothing is written by hand.
"""
