"""A controller's own Python as C: run once on arrays that write down what is done to them."""
