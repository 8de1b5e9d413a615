"""Serve a policy that `lerobot-train` saved, so that Layflat can roll it out and grade it.

    pip install websockets msgpack          # in the Python that LeRobot (0.4 or 0.6) runs in
    python lerobot_server.py CHECKPOINT [--port P]
    layflat evaluate act=ws://127.0.0.1:8765 --robot hanger --episodes 10 --out runs/act

It needs no Layflat. The protocol is that of openpi's policy servers (msgpack with numpy arrays over a websocket):
nothing that a stranger sends can run, as it could by pickle. Only programs on this machine can connect.
"""

from __future__ import annotations

import argparse
import copy
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from websockets.sync.server import ServerConnection, serve

HOST, PORT = "127.0.0.1", 8765
LARGEST_MESSAGE = 64 << 20
CAMERA = "observation.images.camera"


class LeRobotPolicy:
    """A checkpoint's policy with its normalization; ``folder`` is .../checkpoints/last/pretrained_model."""

    def __init__(self, folder: Path) -> None:
        import torch
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors

        self._torch = torch
        config = PreTrainedConfig.from_pretrained(folder)
        config.device = "cpu"
        self._policy = get_policy_class(config.type).from_pretrained(folder, config=config).eval()
        self._before, self._after = make_pre_post_processors(
            config, pretrained_path=str(folder), preprocessor_overrides={"device_processor": {"device": "cpu"}}
        )
        self.inputs = set(config.input_features)

    def act(self, message: dict[str, Any]) -> np.ndarray:
        """Return the action for an observation of Layflat, in shares of the action limit."""
        torch, batch = self._torch, {}
        if message["step"] == 0 or message["resumed"]:
            self._policy.reset()  # Forget the chunk of actions that is under way.
        for key, values in as_lerobot(message).items():
            if key in self.inputs:
                tensor = torch.from_numpy(np.array(values))
                batch[key] = (tensor.permute(2, 0, 1).float() / 255 if key == CAMERA else tensor).unsqueeze(0)
        with torch.inference_mode():
            return self._after(self._policy.select_action(self._before(batch))).numpy()


def as_lerobot(seen: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return an observation under the keys of the export; works for gymnasium's observations too."""
    state = [seen["corner_positions"].ravel(), seen["holder_position"]]
    cloth = [seen["word"], seen["word_strength"], seen["contact_portion"]]
    found = {
        "observation.state": np.concatenate(state).astype(np.float32),
        "observation.environment_state": np.concatenate(cloth).astype(np.float32),
    }
    return found | ({CAMERA: seen["rgb"]} if "rgb" in seen else {})


def packed(message: dict[str, Any]) -> bytes:
    """Return a message as bytes."""

    def encode(values: np.ndarray) -> dict[bytes, Any]:
        return {b"__ndarray__": True, b"data": values.tobytes(), b"dtype": values.dtype.str, b"shape": values.shape}

    return msgpack.packb(message, default=encode)


def unpacked(data: bytes) -> dict[str, Any]:
    """Return the message of bytes."""

    def decode(value: dict[Any, Any]) -> Any:
        if b"__ndarray__" not in value:
            return value
        return np.frombuffer(value[b"data"], np.dtype(value[b"dtype"])).reshape(value[b"shape"])

    return msgpack.unpackb(data, object_hook=decode, strict_map_key=False)


def answer(connection: ServerConnection, template: LeRobotPolicy) -> None:
    """Serve one connection with a policy of its own."""
    policy = copy.deepcopy(template, {id(template._torch): template._torch})
    connection.send(packed({"images": CAMERA in policy.inputs, "stateful": True}))
    for data in connection:
        try:
            connection.send(packed({"actions": policy.act(unpacked(data))}))
        except (ValueError, LookupError, TypeError) as error:
            connection.send(f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Serve a policy of LeRobot on this machine.")
    parser.add_argument("checkpoint", type=Path, help="folder .../checkpoints/last/pretrained_model")
    parser.add_argument("--port", type=int, default=PORT, help="0 takes a free one")
    options = parser.parse_args()
    policy = LeRobotPolicy(options.checkpoint)
    limits = {"compression": None, "max_size": LARGEST_MESSAGE, "origins": [None]}
    with serve(lambda connection: answer(connection, policy), HOST, options.port, **limits) as server:
        print(f"ws://{HOST}:{server.socket.getsockname()[1]}", flush=True)
        server.serve_forever()
