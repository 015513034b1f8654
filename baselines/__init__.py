"""Controllers: feedforward and feedback, each with ``predict(observation, ...)``.

======================================  ============================================================
name                                    controller
======================================  ============================================================
``none``                                static gain of the belief
``inversion-free-literal``              Eq. 6 and 7 as printed: rate of its own command
``inversion-free-reference-rate``       Eq. 6 at the rate of the reference over A
``inversion-free-low-passed``           Eq. 6 with its own rate low-passed
``static-inverse-multiplicative``       Eq. 6 with the rate ignored, the paper's [8]
``classical-literal``                   classical inverse at the rate of its own command
``classical-reference-rate``            classical inverse at the rate of the reference over A
``classical-low-passed``                classical inverse with its own rate low-passed
``classical-static``                    classical inverse, rate ignored
``extended-inverse``                    inverses of the belief's effects around the classical one
``core-inverse``                        inverse of any hysteresis core, by search in each sample
``pi``                                  PI, tuned from the belief
``pi-<feedforward>``                    PI on the error that one of the above leaves
``adaptive-feedforward``                the inverse of what the belief lacks, estimated online
``adaptive-inverse``                    classical inverse of weights that are estimated online
``model-predictive``                    the belief over the preview, with a disturbance estimate
``hybrid``                              feedback at rest, adaptive feedforward in motion
``repetitive``                          adds what was missing one period ago
``iterative-learning``                  learns a reference pass by pass (a track of its own)
``preview-inversion``                   inversion of the belief over the whole reference, in advance
``pi-preview``                          PI with notch and low-pass on an inverse that is read ahead
``integral-resonant``                   a mode is damped by an integrator in positive feedback
``positive-position``                   a mode is damped by a resonant filter of the position
``dual-loop``                           a mode is damped by a non-minimum-phase all-pass
``adaptive-dual-loop``                  the same on the adaptive feedforward
``adaptive-core-bank``                  the same on a mixture of cores, its weights estimated online
``smith-predictor``                     PI on a model of the path without its delay
``lqg-preview``                         state feedback with a disturbance observer
``h-infinity``                          mixed-sensitivity design, by python-control
======================================  ============================================================

Aliases say what adapts: ``adaptive-inverse-dynamics`` (``adaptive-feedforward``), ``adaptive-play-weights``
(``adaptive-inverse``), ``adaptive-feedforward-dual-loop`` (``adaptive-dual-loop``),
``adaptive-feedforward-integral`` (``hybrid``).

What has knobs says so, see :mod:`baselines.tuning`. A new controller is one file in this folder: a subclass of :class:`baselines.base.Baseline` that
states its ``name``. One of another project is named by an entry point of the group
``rdpi_gym.controllers``, or typed as ``module:attribute``.
"""

from baselines.base import Baseline
from baselines.feedforward import Feedforward
from baselines.lookup import GUARDED, LEARNED, find_factory, make_controller, policy_of
from baselines.model_predictive import HORIZON_BOUND, TrueHorizon
from baselines.preview import FULL_PREVIEW, FullPreviewInversion
from baselines.registry import (
    CONTROLLERS,
    FEEDFORWARDS,
    inverts_any_core,
    inverts_effects,
    known_controller,
    needed_core,
)
from rdpi_gym.envs.controller import Controller, ControllerFactory

__all__ = [
    "CONTROLLERS",
    "FEEDFORWARDS",
    "FULL_PREVIEW",
    "GUARDED",
    "HORIZON_BOUND",
    "LEARNED",
    "Baseline",
    "Controller",
    "ControllerFactory",
    "Feedforward",
    "FullPreviewInversion",
    "TrueHorizon",
    "find_factory",
    "inverts_any_core",
    "inverts_effects",
    "known_controller",
    "make_controller",
    "needed_core",
    "policy_of",
]
