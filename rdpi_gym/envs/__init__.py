"""Environments: what a plant and a reference show to a controller, and what the controller may do."""

from rdpi_gym.envs.controller import Controller, ControllerFactory
from rdpi_gym.envs.layout import ActionMode, ObservationLayout
from rdpi_gym.envs.piezo_tracking import PiezoTrackingEnv
from rdpi_gym.envs.tracking import TrackingTask
from rdpi_gym.envs.unit_box import UnitBox

__all__ = [
    "ActionMode",
    "Controller",
    "ControllerFactory",
    "ObservationLayout",
    "PiezoTrackingEnv",
    "TrackingTask",
    "UnitBox",
]
