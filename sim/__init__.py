"""The simulation: robots, cloths, tasks, disturbances and a camera on a physics engine, and a Gymnasium environment."""
