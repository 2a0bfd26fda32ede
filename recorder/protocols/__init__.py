"""Bytes on a serial line ↔ reports of a robot: one file a protocol, pure, knowing no port."""
