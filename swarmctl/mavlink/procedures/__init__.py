"""Procedures of several conversations: launch, land, upload and verify, fence, rally points, speed."""
