"""Recording: from open links to a session, with keys to control it and a screen to watch it."""

from recorder.recording.loop import SessionSink, record
from recorder.recording.status import RecordingStatus
from recorder.translation import RecordingCounters

__all__ = ["RecordingCounters", "RecordingStatus", "SessionSink", "record"]
