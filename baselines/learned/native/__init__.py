"""PPO of our own: one process, large batches, gradients in a few matrix products.

Between environment and network stands no wrapper and no autograd: lanes write what they show into the
rollout, and actor and critic run as one batch of two networks.
"""
