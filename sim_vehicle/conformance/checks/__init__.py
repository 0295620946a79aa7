"""The checks by category. The import of a module registers its checks."""
