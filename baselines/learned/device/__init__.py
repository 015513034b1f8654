"""PPO on a torch device: plants, observations, networks, rollout and updates stay there.

What runs again and again is a function of no argument that looks at no value and changes tensors in
place: on CUDA it is captured as a graph, on a CPU it runs as it is. The host knows when an episode
ends, draws, and reads some numbers between two rounds.
"""
