"""What the project measured about itself: speed, trainings, costs, and the makers of its pages."""
