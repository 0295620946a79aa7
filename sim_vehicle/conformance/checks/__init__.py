"""The checks, one file a category; the import of a file registers its checks."""
