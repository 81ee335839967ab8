"""Files of the video program Tracker: .trk, .trz and text exports, what looks wrong in them, and
runs made of them.

Read `importing` first.
"""
