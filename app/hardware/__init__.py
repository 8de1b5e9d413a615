"""The real station: a Franka arm and a RealSense camera as an environment, and a digital twin of both."""
