"""What ``import rdpi_gym as rg`` gives: one function a task, and results that show themselves.

Each file holds one task and its result: a result of the rooms below that also prints, draws, saves
and goes on. Nothing here computes.
"""
