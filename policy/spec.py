"""PolicySpec: which policy, as the command line names it: a model or a built-in name, and what is around it."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from layflat.data.cloth_frame import NOMINAL_M, ClothFrame
from layflat.data.environment_spec import EnvironmentSpec
from layflat.data.robot import RobotSpec
from layflat.data.types import GroundTruth
from layflat.perception.descriptors.registry import DEFAULT_DESCRIPTOR
from layflat.policy import model_io, registry
from layflat.policy.base import Policy, PolicyError
from layflat.policy.environment import Environment
from layflat.policy.features import WORLD
from layflat.policy.foreign.factory import PolicyFactory
from layflat.policy.foreign.remote import PolicyServer
from layflat.policy.scripted import wrinkle_removal
from layflat.policy.scripted.demonstrator import NO_GROUND_TRUTH, SMALL_M, ScriptedDemonstrator
from layflat.policy.trained_model import TrainedModel
from layflat.policy.wrappers.blocked import UnblockingPolicy
from layflat.policy.wrappers.cloth_frame import ClothFramePolicy
from layflat.policy.wrappers.sequential import SequentialPolicy

SCRIPTED = ScriptedDemonstrator.name
SMOOTH = "smooth"
"""The task whose built-in policies are the controllers of wrinkle removal."""
WORD_CONTROLLER = "word"
"""Controller that demonstrates wrinkle removal: Algorithm 2."""
BUILTIN_NAMES = tuple(dict.fromkeys((SCRIPTED, *registry.BUILTIN_POLICIES, *wrinkle_removal.CONTROLLERS)))
"""Policies that need no model; which of them a task has, says `builtin_names`."""
_TEXT = re.compile(r"(?:(?P<label>[^=/]+)=)?(?P<policy>.+)")
_LABEL = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+@]*(-[A-Za-z0-9._+@]+)*")


@dataclass(frozen=True, kw_only=True)
class PolicySpec:
    """A trained model, a built-in policy or the user's own, what repairs after a disturbance, and the wrappers."""

    model: TrainedModel | None = None
    builtin: str | None = None
    """Name of a built-in policy; with another policy, the one that takes over after a disturbance."""
    foreign: PolicyFactory | PolicyServer | None = None
    """Where a policy of the user's comes from."""
    wrappers: tuple[str, ...] = ()
    """Names of policy.registry.WRAPPERS, the last one outermost."""
    label: str = ""
    """Name in tables and files; by default made of the parts."""
    stem: str = ""
    """Name of the model's file, which is added to labels that would be the same."""

    def __post_init__(self) -> None:
        if self.model is None and self.builtin is None and self.foreign is None:
            raise PolicyError("a policy is a model, the name of a built-in policy, a factory or a server's address")
        if not self.label:
            first = self.model.policy if self.model else self.foreign.label if self.foreign else None
            parts = [first, self.builtin, *self.wrappers]
            object.__setattr__(self, "label", "+".join(part for part in parts if part is not None))
        if not _LABEL.fullmatch(self.label):
            raise PolicyError(f"policy name {self.label!r} cannot be part of a file name; use letters, digits and .+@-")
        known = registry.BUILTIN_POLICIES if self.model or self.foreign else BUILTIN_NAMES
        for kind, names, choices in (("policy", (self.builtin,), known), ("wrapper", self.wrappers, registry.WRAPPERS)):
            for name in names:
                if name is not None and name not in choices:
                    raise PolicyError(f"{kind} {name!r} is unknown; it must be one of {', '.join(sorted(choices))}")

    @property
    def robot(self) -> RobotSpec | None:
        """Robot of the model; None for a built-in policy, which suits any."""
        return None if self.model is None else self.model.layout.robot

    @property
    def descriptor(self) -> str:
        """Descriptor that the observations' WORD must come from."""
        return DEFAULT_DESCRIPTOR if self.model is None else self.model.descriptor

    def make(self, env: Environment) -> Policy:
        """Make the policy for an environment; PolicyError where it was trained for another robot."""
        policy = self._make_first(env)
        frame = self._frame(env.spec)
        if self.builtin is not None and policy is not None:
            rule = _builtin(self.builtin, env, frame)
            policy = SequentialPolicy(policy, rule, name=f"{policy.name}+{self.builtin}")
        policy = registry.wrap(policy or _builtin(str(self.builtin), env, frame), self.wrappers)
        if self._is_laying(env.spec):
            policy = UnblockingPolicy(policy)
        return policy if frame is None else ClothFramePolicy(policy, frame)

    def _is_laying(self, spec: EnvironmentSpec) -> bool:
        """Whether the policy lays a cloth, and is neither the user's own nor as the thesis has it."""
        thesis = self.model is not None and self.model.layout.frame == WORLD
        return self.foreign is None and not thesis and spec.task != SMOOTH

    def _frame(self, spec: EnvironmentSpec) -> ClothFrame | None:
        """Return the coordinates in which the policy acts; None: the world's."""
        if not self._is_laying(spec):
            return None
        shape = spec.cloth_shape
        if shape is not None:
            frame = ClothFrame(length_m=shape.length_m, width_m=shape.width_m)
        elif self.model is not None and self.model.cloths:  # Not measured: as the cloth that it was taught on.
            frame = ClothFrame(length_m=self.model.cloths[0].length_m, width_m=self.model.cloths[0].width_m)
        else:
            return None
        return None if frame.is_world else frame

    def _make_first(self, env: Environment) -> Policy | None:
        """Make the model's policy or the user's; None for a built-in one."""
        robot = env.spec.robot
        if self.foreign is not None:
            return self.foreign.make(env.spec, self.label.partition("+")[0])
        if self.model is not None and not robot.same_axes(self.model.layout.robot):
            raise PolicyError(f"{self.label} was trained for robot {self.model.layout.robot}, not {robot}")
        return None if self.model is None else registry.from_model(self.model)

    def check_task(self, task: str) -> None:
        """Raise PolicyError where the task has no built-in policy of that name."""
        if self.builtin is not None and self.builtin not in builtin_names(task):
            known = ", ".join(builtin_names(task))
            raise PolicyError(f"policy {self.builtin!r} is not one of task {task}; give one of {known}, or a model")

    def with_file_name(self) -> PolicySpec:
        """Return the same policy, labelled with the name of its file as well."""
        return replace(self, label=f"{self.label}@{re.sub(r'[^A-Za-z0-9.]+', '-', self.stem).strip('-')}")

    @classmethod
    def parse(cls, text: str) -> PolicySpec:
        """Read ``[LABEL=]POLICY[+RULE][+WRAPPER...]``.

        POLICY is ``MODEL.npz``, a built-in name (without a rule), ``package.module:factory``, a name of the
        entry-point group ``layflat.policies``, or ``ws://HOST:PORT``.

        Raises
        ------
        PolicyError
            Where there is no such file or name, the file is no model, or the factory is none.
        """
        if text in BUILTIN_NAMES:  # even where a file has that name
            return cls(builtin=text, stem=text)
        path = Path(os.path.expanduser(text))  # The shell expands no ~ behind =.
        if path.exists():
            return cls(model=model_io.load(path), stem=path.stem)
        parts = _TEXT.fullmatch(text)
        label, (first, *rest) = (None, [text]) if parts is None else (parts["label"], _split(parts["policy"]))
        wrappers = tuple(word for word in rest if word in registry.WRAPPERS)
        rule = next((word for word in rest if word in registry.BUILTIN_POLICIES), None)
        if rest != [*([rule] if rule else ()), *wrappers]:
            raise PolicyError(f"policy {text!r}: after the model one rule may follow, and then the wrappers")
        if first in BUILTIN_NAMES and rule is None:
            return cls(builtin=first, wrappers=wrappers, label=label or "", stem=first)
        foreign = PolicyServer(first) if first.startswith(("ws://", "wss://")) else PolicyFactory.find(first)
        if foreign is not None:
            return cls(foreign=foreign, builtin=rule, wrappers=wrappers, label=label or "", stem=foreign.label)
        path = Path(os.path.expanduser(first))
        if path.suffix != ".npz":
            raise PolicyError(
                f"policy {text!r} is neither a model (MODEL.npz), nor one of {', '.join(BUILTIN_NAMES)}, nor "
                "MODULE:FACTORY, nor ws://HOST:PORT"
            )
        model = model_io.load(path)
        return cls(model=model, builtin=rule, wrappers=wrappers, label=label or "", stem=path.stem)


def builtin_names(task: str) -> tuple[str, ...]:
    """Return the names of a task's policies that need no model."""
    return (SCRIPTED, *(wrinkle_removal.CONTROLLERS if task == SMOOTH else registry.BUILTIN_POLICIES))


def _builtin(name: str, env: Environment, frame: ClothFrame | None) -> Policy:
    if name == SCRIPTED:
        name = env.spec.demonstrator
    if name == SCRIPTED:
        shape = env.spec.cloth_shape
        if shape is None:
            raise PolicyError(f"the scripted demonstrator needs the size of cloth {env.spec.cloth}, which is not known")
        if env.ground_truth() is None:
            raise PolicyError(NO_GROUND_TRUTH)
        length, width, ground_truth = shape.length_m, shape.held_width_m, env.ground_truth
        if frame is not None:
            length, width, ground_truth = NOMINAL_M, NOMINAL_M * width / shape.width_m, _framed(ground_truth, frame)
        return ScriptedDemonstrator(
            env.spec.robot,
            length_m=length,
            columns=shape.columns,
            held_width_m=width,
            ground_truth=ground_truth,
            taut=shape.length_m < SMALL_M,
        )
    if env.spec.task == SMOOTH:  # whose controllers share names with those of other tasks
        return wrinkle_removal.controller(name, env.spec.robot)
    return registry.make(name, env.spec.robot)


def _framed(ground_truth: Callable[[], GroundTruth | None], frame: ClothFrame) -> Callable[[], GroundTruth | None]:
    """Return the ground truth whose nodes near the table are in the frame."""

    def framed() -> GroundTruth | None:
        truth = ground_truth()
        return None if truth is None else replace(truth, nodes=frame.on_table(truth.nodes))

    return framed


def _split(text: str) -> list[str]:
    """Split a policy from the known words behind it: of a file name only the end can be one."""
    words: list[str] = []
    while True:
        first, plus, word = text.rpartition("+")
        if not plus or word not in (*registry.BUILTIN_POLICIES, *registry.WRAPPERS):
            return [text, *words]
        text, words = first, [word, *words]
