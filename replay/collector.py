"""What a run comes to at its end: collected from its artifacts by all who need more than a step."""

from __future__ import annotations

from mapping.artifacts import Artifact, Border, Finished, RawPoints, Segment, Snapshot, Started
from mapping.parameters import Sensor


class Collector:
    """Call it with each artifact of a run; what it holds is what was found last.

    Stages may be shown again and again meanwhile: the borders and lines of an earlier map are no
    results. ``snapshots`` are the final maps by layer, ``beam_widths_rad`` those of their readings;
    ``sensors`` are all of the run, settled; ``finished`` is None until it has ended.
    """

    def __init__(self) -> None:
        self.snapshots: dict[str, Snapshot] = {}
        self.borders: list[Border] = []
        self.points: list[RawPoints] = []
        self.segments: list[Segment] = []
        self.finished: Finished | None = None
        self.beam_widths_rad: dict[str, float] = {}
        self.sensors: tuple[Sensor, ...] = ()

    def __call__(self, artifact: Artifact) -> None:
        """Keep what belongs to the results."""
        match artifact:
            case Started():
                self.beam_widths_rad = dict(artifact.beam_widths_rad)
                self.sensors = artifact.sensors
            case Snapshot():
                self._begin_layer(artifact)
            case Border():
                self.borders.append(artifact)
            case RawPoints():
                self.points.append(artifact)
            case Segment():
                self.segments.append(artifact)
            case Finished():
                self.finished = artifact
            case _:
                pass

    @property
    def clearest(self) -> str:
        """The layer of the narrowest beams, whose walls are thin; the last one where many are so.

        The last one, fused where there is one, stands in as well for a map that has no walls.
        """
        widths_rad = self.beam_widths_rad
        last = next(reversed(self.snapshots), "")
        narrowest = [n for n in widths_rad if widths_rad[n] == min(widths_rad.values())]
        if len(narrowest) != 1 or narrowest[0] not in self.snapshots:
            return last
        walls = (self.snapshots[narrowest[0]].layer.probability > 0.5).any()
        return narrowest[0] if walls else last

    def _begin_layer(self, snapshot: Snapshot) -> None:
        name = snapshot.layer.name
        self.borders = [each for each in self.borders if each.layer != name]
        self.segments = [each for each in self.segments if each.layer != name]
        if snapshot.final:
            self.snapshots[name] = snapshot
