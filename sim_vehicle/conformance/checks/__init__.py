"""The checks, one file a category; each registers its functions when it is imported."""
