"""What every sensor model and every update rule must keep, tried on random readings.

Each law is a plain function that returns a sentence on what failed, or None. ``MODEL_LAWS`` and
``RULE_LAWS`` name them; ``check_model`` and ``check_rule`` try all of them on one subject. The
cases are seeded, so the same file fails in the same way again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from mapping.laws.made_readings import Draw
from mapping.laws.model_laws import MODEL_LAWS
from mapping.laws.rule_laws import RULE_LAWS
from mapping.plugins import load_plugin
from mapping.sensor_model import SensorModel
from mapping.update_rules import UpdateRule

__all__ = [
    "MODEL_LAWS",
    "RULE_LAWS",
    "Finding",
    "check_model",
    "check_plugin",
    "check_rule",
]

Subject = TypeVar("Subject")


@dataclass(frozen=True, slots=True)
class Finding:
    """A law tried on a model or a rule: ``broken`` is a sentence on what failed, or None."""

    subject: str
    law: str
    broken: str | None


def check_model(model: SensorModel, *, seed: int = 0) -> list[Finding]:
    """Try every law of sensor models on one."""
    return [
        Finding(f"sensor model {model.name}", name, _tried(law, model, seed))
        for name, law in MODEL_LAWS.items()
    ]


def check_rule(rule: UpdateRule, *, seed: int = 0) -> list[Finding]:
    """Try every law of update rules on one; the longest takes seconds."""
    return [
        Finding(f"update rule {rule.name}", name, _tried(law, rule, seed))
        for name, law in RULE_LAWS.items()
    ]


def check_plugin(path: Path | str, *, seed: int = 0) -> list[Finding]:
    """Load a file and try the laws on all that it defines; BadInput where it cannot be loaded."""
    plugin = load_plugin(path)
    findings = [f for model in plugin.models for f in check_model(model, seed=seed)]
    return findings + [f for rule in plugin.rules for f in check_rule(rule, seed=seed)]


def _tried(law: Callable[[Subject, Draw], str | None], subject: Subject, seed: int) -> str | None:
    """Run a law; an exception of the subject is a finding, too."""
    try:
        return law(subject, np.random.default_rng(seed))
    except Exception as error:
        return f"raised {type(error).__name__}: {' '.join(str(error).split())}"
