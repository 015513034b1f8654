"""Plant and compensators as C: one sample of a model as code without libraries and without allocation."""
