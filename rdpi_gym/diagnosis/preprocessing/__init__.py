"""Preprocessing: what is wrong with records before any model is asked, found and left out."""
