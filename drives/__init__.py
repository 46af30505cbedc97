"""What a robot's wheels do: one class a drive, and DRIVES to find each by the contract's name."""

from __future__ import annotations

from drives.ackermann import Ackermann
from drives.differential import Differential
from drives.drive import Drive
from drives.mecanum import Mecanum
from drives.omni import Omni
from drives.powered_caster import PoweredCaster
from drives.skid_steer import SkidSteer
from drives.swedish import Swedish
from drives.swerve import Swerve
from drives.synchro import Synchro
from drives.tracked import Tracked
from drives.tricycle import Tricycle
from drives.wheel import Module, SwedishWheel

__all__ = [
    "DRIVES", "Ackermann", "Differential", "Drive", "Mecanum", "Module", "Omni", "PoweredCaster", "SkidSteer",
    "Swedish", "SwedishWheel", "Swerve", "Synchro", "Tracked", "Tricycle",
]  # fmt: skip

DRIVES: dict[str, type[Drive]] = {
    drive.kind: drive
    for drive in (
        Differential, Tracked, SkidSteer, Omni, Mecanum, Swedish, Tricycle, Ackermann, Synchro, Swerve,
        PoweredCaster,
    )
}  # fmt: skip
"""Every drive by its kind, in the contract's order."""
