"""Controllers: feedforward and feedback, each with predict(observation, ...)."""
