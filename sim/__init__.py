"""The bench: cloth, table, holders, camera and disturbances in PyBullet, and two gymnasium environments.

``import sim`` registers ``layflat/HangerPlace-v0`` and ``layflat/PickersPlace-v0``; what they are is in
``layflat.sim.env``.
"""

from gymnasium.envs.registration import register

import layflat.sim.physics.bullet.suppress_output  # noqa: F401  # before anything else imports PyBullet

MAX_EPISODE_STEPS = 200
"""Steps after which an environment truncates: 20 s."""

for _name, _robot in (("HangerPlace", "hanger"), ("PickersPlace", "pickers")):
    register(
        id=f"layflat/{_name}-v0",
        entry_point="layflat.sim.env:PlaceEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
        kwargs={"robot": _robot},
    )
