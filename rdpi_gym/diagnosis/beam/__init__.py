"""Diagnosis by one law: one score, one decision, a beam of sets."""
