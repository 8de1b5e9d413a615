"""Serve a policy that `lerobot-train` saved to programs on this machine.

    python lerobot_server.py CHECKPOINT [--port P]

It needs LeRobot (0.4 or 0.6, any Python that it runs on) and not Layflat. Requests and answers are JSON, arrays in it
base64: nothing that a stranger sends can run, as it could by pickle. Only this machine can connect.

    GET /        {"inputs": {"observation.state": [9], ...}}   what the policy wants to see
    POST /reset  {}                                            a new episode begins
    POST /act    {"observation.state": ARRAY, ...}             {"action": [...]} in shares of the action limit
"""

from __future__ import annotations

import argparse
import base64
import json
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np

HOST, PORT = "127.0.0.1", 8765
LARGEST_REQUEST = 64 << 20
DTYPES = ("float32", "uint8")


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
        self.inputs = {key: list(feature.shape) for key, feature in config.input_features.items()}

    def reset(self) -> None:
        """Forget the chunk of actions that is under way."""
        self._policy.reset()

    def act(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """Return the action for one observation: numbers as float32, images as uint8 (H, W, 3)."""
        torch, batch = self._torch, {}
        for key, values in observation.items():
            tensor = torch.from_numpy(np.array(values))
            if values.dtype == np.uint8:
                tensor = tensor.permute(2, 0, 1).float() / 255
            batch[key] = tensor.unsqueeze(0)
        with torch.inference_mode():
            action = self._after(self._policy.select_action(self._before(batch)))
        return action.squeeze(0).numpy()


def encoded(values: np.ndarray) -> dict[str, Any]:
    """Return an array as JSON can hold it."""
    data = base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
    return {"dtype": str(values.dtype), "shape": list(values.shape), "base64": data}


def decoded(value: dict[str, Any]) -> np.ndarray:
    """Return the array; ValueError where it is none."""
    if value["dtype"] not in DTYPES:
        raise ValueError(f"dtype is {value['dtype']!r}; it must be one of {', '.join(DTYPES)}")
    return np.frombuffer(base64.b64decode(value["base64"]), value["dtype"]).reshape(value["shape"])


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    policy: LeRobotPolicy

    def do_GET(self) -> None:
        """Say what the policy wants to see."""
        self._answer(200, {"inputs": self.policy.inputs})

    def do_POST(self) -> None:
        """Reset the policy, or let it act."""
        try:
            length = int(self.headers.get("Content-Length", 0))
            if self.path not in ("/reset", "/act") or length > LARGEST_REQUEST:
                raise ValueError("POST /reset or /act with at most 64 MB of JSON")
            content = json.loads(self.rfile.read(length) or "{}")
            if self.path == "/reset":
                self.policy.reset()
                self._answer(200, {})
                return
            action = self.policy.act({key: decoded(content[key]) for key in self.policy.inputs})
            self._answer(200, {"action": action.tolist()})
        except (ValueError, LookupError, TypeError) as error:
            self._answer(400, {"error": f"{type(error).__name__}: {error}"})

    def _answer(self, status: int, content: dict[str, Any]) -> None:
        body = json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *arguments: object) -> None:
        """Print no line for each request."""


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Serve a policy of LeRobot on this machine.")
    parser.add_argument("checkpoint", type=Path, help="folder .../checkpoints/last/pretrained_model")
    parser.add_argument("--port", type=int, default=PORT, help="0 takes a free one")
    options = parser.parse_args()
    Handler.policy = LeRobotPolicy(options.checkpoint)
    server = HTTPServer((HOST, options.port), Handler)
    print(f"http://{HOST}:{server.server_port}", flush=True)
    server.serve_forever()
