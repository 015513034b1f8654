"""Controllers: feedforward and feedback, each with ``predict(observation, ...)``.

======================================  ============================================================
name                                    controller
======================================  ============================================================
``none``                                static gain of the belief
``inversion-free-literal``              Eq. 6 and 7 as printed: rate of its own command
``inversion-free-reference-rate``       Eq. 6 at the rate of the reference over A
``inversion-free-low-passed``           Eq. 6 with its own rate low-passed
``classical-literal``                   classical inverse at the rate of its own command
``classical-reference-rate``            classical inverse at the rate of the reference over A
``classical-low-passed``                classical inverse with its own rate low-passed
``classical-static``                    classical inverse, rate ignored
``extended-inverse``                    inverses of the belief's effects around the classical one
``pi``                                  PI, tuned from the belief
``pi-<feedforward>``                    PI on the error that one of the above leaves
``preview-oracle``                      iterative inversion over the whole reference, planned ahead
======================================  ============================================================
"""

from baselines.base import Controller
from baselines.feedforward import Feedforward
from baselines.feedforwards import FEEDFORWARDS
from baselines.registry import CONTROLLERS, ControllerFactory, known_controller, make_controller

__all__ = [
    "CONTROLLERS",
    "FEEDFORWARDS",
    "Controller",
    "ControllerFactory",
    "Feedforward",
    "known_controller",
    "make_controller",
]
