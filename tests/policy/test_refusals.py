"""Values that make no sense are refused with one sentence that names them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from layflat.data.errors import DataError
from layflat.data.types import ACTION_LIMIT_M
from layflat.policy import registry
from layflat.policy.base import Decision, PolicyError
from layflat.policy.dmp import DmpModel
from layflat.policy.features import FeatureLayout, input_set
from layflat.policy.gmr import GmrModel
from layflat.policy.gp.fit import FitOptions
from layflat.policy.gp.kernel import Hyperparameters
from layflat.policy.nearest import NearestModel
from layflat.policy.schedule import ScheduledDisturbance, Trigger
from layflat.policy.scripted.baselines import DragPolicy, RandomPolicy
from layflat.policy.scripted.wrinkle_removal import WordFlatten, controller
from layflat.policy.stopping import AnyOf, NoContactGain, Stuck, below_threshold, contact_reached
from layflat.policy.wrappers.sequential import SequentialPolicy
from layflat.policy.wrappers.takeover import MotionTakeoverTrigger, TakeoverPolicy
from layflat.tests.factories import HANGER, PICKERS
from layflat.tests.policy.factories import demonstrations, episode_of, gp_model, observe, trained_model

ALL, POSITION = input_set(HANGER, "all"), input_set(HANGER, "position")
COMMON = {"policy": "p", "cloth": "towel"}
BAD_STEPS = (0.0, -1.0, 2 * ACTION_LIMIT_M, float("nan"))
HOLD, PICKERS_HOLD = registry.make("hold", HANGER), registry.make("hold", PICKERS)


def decision(**fields: object) -> Decision:
    return Decision(**{"action": [0.0, 0.0], **fields})


def gmr(**fields: object) -> GmrModel:
    parts = {"weights": [0.5, 0.5], "means": np.zeros((2, 7)), "covariances": [np.eye(7)] * 2, "output_scale_m": 0.01}
    return GmrModel(**{**COMMON, "layout": ALL, "input_scale": ALL.scales(), **parts, **fields})


def dmp(**fields: object) -> DmpModel:
    return DmpModel(
        **{**COMMON, "layout": POSITION, "goal": np.zeros(2), "weights": np.zeros((2, 3)), "duration_s": 1.0, **fields}
    )


def nearest(**fields: object) -> NearestModel:
    parts = {"inputs": np.zeros((4, 5)), "actions": np.zeros((4, 2)), "input_scale": ALL.scales()}
    return NearestModel(**{**COMMON, "layout": ALL, **parts, **fields})


def hyper(**fields: object) -> Hyperparameters:
    good = {"kernel": "se", "length_scales": np.ones((2, 2)), "variance": np.ones(2), "noise": np.ones(2)}
    return Hyperparameters(**{**good, **fields})


def trigger(kind: str, value: float) -> Callable[[], object]:
    return lambda: Trigger(kind=kind, value=value)


def mixed(**changes: object) -> Callable[[], object]:
    first, second, _ = demonstrations(HANGER)
    return lambda: registry.train("nearest", [first, replace(second, **changes)])


def short(**fields: object) -> object:
    return episode_of(4 * [observe()], np.zeros((4, fields.get("robot", HANGER).size)), **fields)


CASES = {
    "action holds a value that is not finite": lambda: decision(action=[np.nan, 0.0]),
    "action has shape": lambda: decision(action=[[0.0, 0.0]]),
    "std has shape": lambda: decision(std=[0.1]),
    "hand": lambda: decision(hand=[0.0, 0.0]),
    "weights sum to 1.1; .* sum to 1": lambda: gmr(weights=[0.5, 0.6]),
    "weights .* must be above 0": lambda: gmr(weights=[1.5, -0.5]),
    "means has shape": lambda: gmr(means=np.zeros((2, 6))),
    "a covariance is not positive": lambda: gmr(covariances=np.zeros((2, 7, 7))),
    "output_scale_m is 0": lambda: gmr(output_scale_m=0.0),
    "input_scale is 0.0; it must be above 0": lambda: gmr(input_scale=np.zeros(5)),
    "goal has shape": lambda: dmp(goal=np.zeros(3)),
    "at least 2 basis": lambda: dmp(weights=np.zeros((2, 1))),
    "duration_s is 0": lambda: dmp(duration_s=0.0),
    "sees the position only": lambda: dmp(layout=ALL),
    "actions has shape": lambda: nearest(actions=np.zeros((3, 2))),
    "input_scale is 0.0": lambda: nearest(input_scale=np.zeros(5)),
    "needs at least one point": lambda: nearest(inputs=np.zeros((0, 5)), actions=np.zeros((0, 2))),
    "alpha has shape": lambda: replace(gp_model(), alpha=np.zeros((2, 3))),
    "inputs holds a value that is not finite": lambda: replace(gp_model(), inputs=np.full((25, 5), np.nan)),
    "stop_threshold_m is -1.0": lambda: replace(gp_model(), stop_threshold_m=-1.0),
    "action_limit_m is 0.5": lambda: replace(gp_model(), action_limit_m=0.5),
    "heldout_rmse_m has 1": lambda: replace(gp_model(), heldout_rmse_m=(1.0,)),
    "must name its policy, its cloth": lambda: replace(gp_model(), cloth=""),
    r"inputs have shape \(3, 2\); they must be": lambda: gp_model().predict(np.zeros((3, 2))),
    "kernel is 'matern'; it must be one of se": lambda: hyper(kernel="matern"),
    "variance holds 0": lambda: hyper(variance=np.array([1.0, 0.0])),
    "they differ": lambda: hyper(length_scales=np.array([[1.0, 2.0], [1.0, 1.0]])),
    "starts is 0": lambda: FitOptions(starts=0),
    "max_points is 0": lambda: FitOptions(max_points=0),
    "inducing_points is 0": lambda: FitOptions(inducing_points=0),
    "intervention_weight is 0": lambda: registry.train("gp-word", demonstrations(HANGER), intervention_weight=0),
    "gmr cannot weight": lambda: registry.train("gmr", demonstrations(HANGER), intervention_weight=2),
    "feature 'y1' is unknown": lambda: FeatureLayout(robot=HANGER, names=("x", "y1")),
    "none twice": lambda: FeatureLayout(robot=HANGER, names=("x", "x")),
    "at least one": lambda: FeatureLayout(robot=HANGER, names=()),
    "input set 'everything' is unknown; it must be one of position": lambda: input_set(HANGER, "everything"),
    r"step must be an integer >= 0, got 2\.5": trigger("step", 2.5),
    "got -1": trigger("step", -1),
    r"within 0\.\.1, got 1\.5": trigger("contact", 1.5),
    "at least once, got 0": lambda: ScheduledDisturbance(disturbance="wind", repeats=0),
    "threshold_m is 0.0; it must be above 0": lambda: below_threshold(0.0),
    "n_steps is 0; it must be above 0": lambda: below_threshold(0.1, n_steps=0),
    "n_steps is 0": lambda: Stuck(n_steps=0, within_m=0.1),
    "gain is nan": lambda: NoContactGain(n_steps=1, gain=float("nan")),
    "contact is -0.1": lambda: contact_reached(-0.1),
    "hanger cannot": lambda: controller("word", HANGER),
    "'iron' is unknown; .*stretch-right": lambda: controller("iron", PICKERS),
    "rest_steps is 0": lambda: MotionTakeoverTrigger(lambda: True, rest_steps=0),
    "hold is for robot hanger, but hold is for pickers": lambda: TakeoverPolicy(HOLD, PICKERS_HOLD, lambda: None),
    "is for robot hanger, but hold is for pickers": lambda: SequentialPolicy(HOLD, PICKERS_HOLD, name="both"),
    "GP-WORD.*gp-word, gp-baseline": lambda: registry.train("GP-WORD", []),
    "policy 'magic' is unknown.*drag-rule": lambda: registry.make("magic", HANGER),
    "is learned": lambda: registry.make("gp-word", HANGER),
    "must be one of steady, recovery": lambda: registry.wrap(HOLD, ["magic"]),
    "no demonstrations": lambda: registry.train("gp-word", []),
    "hold 4 steps": lambda: registry.train("gp-word", [short()]),
    "is of robot pickers": lambda: registry.train("gp-word", [short(), short(robot=PICKERS)]),
    "mix the cloths towel and silk": mixed(cloth="silk"),
    "mix the tasks place and smooth": mixed(task="smooth"),
    "mix steps": mixed(step_s=0.05),
    "mix the descriptors .* and hog": mixed(descriptor="hog"),
    "model's policy 'magic' is unknown": lambda: registry.from_model(gp_model(policy="magic")),
    "run as dmp": lambda: registry.from_model(replace(trained_model("nearest", HANGER), policy="dmp")),
    **{f"limit_m is {step}": lambda step=step: RandomPolicy(HANGER, limit_m=step) for step in BAD_STEPS},
    **{f"step_m is {step}": lambda step=step: WordFlatten(PICKERS, step_m=step) for step in BAD_STEPS},
    **{
        f"speed_m is {step}": lambda step=step: DragPolicy(HANGER, name="drag", stop=AnyOf(), speed_m=step)
        for step in BAD_STEPS
    },
}


@pytest.mark.parametrize(("message", "wrong"), CASES.items(), ids=CASES)
def test_what_makes_no_sense_is_refused(message, wrong):
    with pytest.raises((PolicyError, DataError), match=message) as caught:
        wrong()
    assert "\n" not in str(caught.value)
