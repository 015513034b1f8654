"""Studies of the project itself: speed, trainings, costs, and the makers of its pages."""
