"""Whole jobs made of conversations: launch, land, upload and verify, fence, rally points, speed."""
