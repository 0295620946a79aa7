"""Procedures: sequences of conversations with one vehicle, such as launch, land, upload and swap."""
