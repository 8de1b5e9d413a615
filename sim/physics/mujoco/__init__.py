"""The MuJoCo engine, an optional one; no other folder imports MuJoCo."""
