"""Learning from the true plant: a recurrent student that corrects the best adaptive controller."""
