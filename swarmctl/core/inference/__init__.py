"""Bayes beyond Eq. 4: an uncertain number of hostiles, sensors that err, survival probabilities."""
