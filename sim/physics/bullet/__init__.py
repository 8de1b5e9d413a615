"""The PyBullet engine; no other folder imports PyBullet."""

import layflat.sim.physics.bullet.suppress_output  # noqa: F401  # before anything else imports PyBullet
