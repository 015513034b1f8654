"""Around the environments: history, scaling, groups of lanes side by side, Stable-Baselines3."""
