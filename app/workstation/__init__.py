"""The workstation: a person demonstrates, watches and disturbs, in a window or in a plain terminal."""
