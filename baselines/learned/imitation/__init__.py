"""Learning from the true plant: a recurrent student that corrects an adaptive controller."""
