"""Controllers that were trained: how to train one, how it is kept, how it is run.

Nothing here is imported before a learned controller is asked for: it needs torch.
"""
